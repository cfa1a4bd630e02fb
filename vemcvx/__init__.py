"""vemcvx: quasistatic frictional contact on polygonal meshes, posed as certified convex programs.

A scene (material, supports, loads, contact, friction) on a polygonal mesh becomes, at every backward-Euler
step, one convex program; solvers of different kinds answer it; every answer carries a certificate that does
not depend on the solver. After Feng, Han and Huang, "A virtual element method for a quasistatic frictional
contact problem"; equation numbers in this package are its.
"""

import lazy_loader

# The names stand in __init__.pyi; each is imported when it is first used.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
