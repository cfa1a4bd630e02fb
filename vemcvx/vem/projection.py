"""The projection Pi_K of Section 3 in vertex values.

For v in (W_K^h)^2, (3.11), the paper fixes the linear field Pi_K v by three conditions: for all linear q

    (eps(Pi v), eps(q))_K = (eps(v), eps(q))_K,   int_dK Pi v ds = int_dK v ds,   int_K rot Pi v dx = int_K rot v dx.

eps(q) runs through all constant symmetric matrices, so the first says that eps(Pi v) is the mean of eps(v) over K, the
third that the rotation of Pi v is the mean rotation. Together: grad Pi v = 1/|K| int_K grad v dx, component by
component, as if each were projected on its own. By Gauss, with v linear on the edges e_i = [x_i, x_{i+1}]
of outward normal n_i (|e_i| n_i = (y_{i+1} - y_i, x_i - x_{i+1})),

    grad Pi v = 1/|K| int_dK v (x) n ds = sum_i v_i (x) G_i,
    G_i = (|e_{i-1}| n_{i-1} + |e_i| n_i) / (2|K|) = (y_{i+1} - y_{i-1}, x_{i-1} - x_{i+1}) / (2|K|),

and the second condition fixes the constant:

    Pi v(x) = sum_i w_i v_i + grad Pi v (x - xbar),   w_i = (|e_{i-1}| + |e_i|) / (2|dK|),   xbar = sum_i w_i x_i.

Nothing here divides by an edge length, so edges may be as short as round-off lets them be; all quantities are
homogeneous in the coordinates, so that scaling these by a power of two changes no bit of G |K| / h, w and Pi.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats


def area_gradients(corners: Floats) -> tuple[Floats, Floats]:
    """Areas |K| (c,) and |K| G_i (c, n, 2) of cells (c, n, 2), counter-clockwise, relative to a point of the cell.

    |K| = sum_i x_i |K| (G_i)_x: the very sum that makes the gradient of x one.
    """
    chord = np.roll(corners, -1, axis=1) - np.roll(corners, 1, axis=1)
    gradients = np.empty_like(corners)
    np.multiply(chord[:, :, 1], 0.5, out=gradients[:, :, 0])
    np.multiply(chord[:, :, 0], -0.5, out=gradients[:, :, 1])
    return np.einsum("ci,ci->c", corners[:, :, 0], gradients[:, :, 0]), gradients


def boundary_weights(corners: Floats) -> Floats:
    """Weights w_i (c, n) of the mean over the boundary of a function linear on edges."""
    edge = np.roll(corners, -1, axis=1) - corners
    length = np.sqrt(np.einsum("cia,cia->ci", edge, edge))
    both = length + np.roll(length, 1, axis=1)
    weights: Floats = both / both.sum(axis=1)[:, None]
    return weights


def vertex_values(corners: Floats) -> Floats:
    """Pi at the vertices, (c, n, n): entry (i, j) is the value at x_i of Pi applied to the basis function of x_j."""
    return values_at_vertices(corners, *area_gradients(corners), boundary_weights(corners))


def values_at_vertices(corners: Floats, measures: Floats, gradients: Floats, w: Floats) -> Floats:
    """The same from |K| (c,), |K| G_i (c, n, dim) and w_i (c, n)."""
    centre = np.einsum("ci,cia->ca", w, corners)
    arms = (corners - centre[:, None]) / measures[:, None, None]
    linear: Floats = np.matmul(arms, gradients.transpose(0, 2, 1))
    return linear + w[:, None, :]
