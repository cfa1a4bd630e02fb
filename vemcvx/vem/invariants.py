"""What of a stress does not depend on the axes: principal stresses in the plane, and von Mises' equivalent stress.

    sigma_1,2 = (xx + yy) / 2 +- sqrt(((xx - yy) / 2)^2 + xy^2)                                 Mohr's circle (1882)
    sigma_v^2 = ((xx - yy)^2 + (yy - zz)^2 + (zz - xx)^2) / 2 + 3 xy^2                          von Mises (1913)

zz, across the plane, is the third principal stress: 0 in plane stress, lam (e_xx + e_yy) and more in plane strain.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats


def principal(stress: Floats) -> Floats:
    """Principal stresses in the plane (n, 2), the larger one first, of stresses (n, 3), (xx, yy, xy)."""
    xx, yy, xy = stress.T
    centre, radius = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    return np.column_stack([centre + radius, centre - radius])


def equivalent(stress: Floats, out_of_plane: Floats) -> Floats:
    """Von Mises' stress (n,) of stresses (n, 3), (xx, yy, xy), in the plane and (n,), zz, across it."""
    xx, yy, xy = stress.T
    apart = (xx - yy) ** 2 + (yy - out_of_plane) ** 2 + (out_of_plane - xx) ** 2
    squared: Floats = 0.5 * apart + 3.0 * xy**2
    return np.sqrt(squared)
