"""vemcvx: quasistatic frictional contact on polygonal meshes, posed as certified convex programs.

A scene (material, supports, loads, contact, friction) on a polygonal or polyhedral mesh becomes one convex
program at every backward-Euler step. Solvers of different kinds solve this program. Every answer has a certificate
that does not depend on the solver. "The paper" is Feng, Han and Huang, "A virtual element method for a
quasistatic frictional contact problem". Numbers of equations refer to the paper.
"""

import lazy_loader

# Names are listed in __init__.pyi, and imported at the first use.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
