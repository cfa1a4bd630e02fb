"""Residual indicators of one state, cell by cell.

    eta_K^2 = c^2 (  h_K^2 / (10 mu) |f|^2_K                                         what the body force leaves
                   + sum over inner edges     h_e / (4 mu) |[sigma n]|^2_e / 2       jumps, half to each neighbour
                   + sum over boundary edges  h_e / (2 mu) |t - sigma n|^2_e         loads, friction, contact, springs
                   + tau |(I - Pi) u|^2 at the vertices                              the stabilisation, as in K
                   + what of the data was not assembled )                            :mod:`.data_oscillation`

with sigma = C eps(Pi u) + sigma_0, h_K = |K|^{1/2}, h_e the mean over the neighbours, and boundary residuals only in
the directions that supports leave free, at interfaces on the edges of both bodies (:mod:`.joints`). In the order of
Verfurth, *A Posteriori Error Estimation Techniques for Finite Element Methods* (2013), and of Cangiani, Georgoulis,
Pryer and Sutton, *A posteriori error estimates for the virtual element method* (Numer. Math. 137, 2017), whose edges
weigh by h_K so that they may be short. Ten is about pi^2, of the Poincare inequality on a cell; c, one for
all, is declared below.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, totals
from vemcvx.estimate.budget.data_oscillation import DataOscillation
from vemcvx.estimate.budget.skeleton import Skeleton
from vemcvx.estimate.budget.surface_forces import Instant, surface_forces
from vemcvx.scene.composition import InitialStresses
from vemcvx.scene.pose import PosedScene
from vemcvx.vem import strains, stresses
from vemcvx.vem.stabilisation import missed_squares

CONSTANT = 0.72
"""c: with c = 1 the sum is 1.8 to 2.2 times the true error on the paper's scene and 2.4 to 2.9 times on manufactured
full slip, on all families and for Poisson's ratios up to .4999995, and 1.4 times where data jump between nodes."""
VOLUME = 0.1


def indicators(posed: PosedScene, edges: Skeleton, oscillation: DataOscillation, now: Instant) -> dict[str, Floats]:
    """Squares (n_cells,) of the parts "volume", "jumps", "boundary", "stabilisation" and "data" of eta_K."""
    strain = strains(posed.space, now.u)
    sigma = stresses(posed.material.moduli, strain)
    if posed.prestress is not None:
        sigma = sigma + posed.prestress.stress(now.t)
    unseen, work = oscillation.squares(now, strain, VOLUME)
    parts = {
        "volume": VOLUME * _volume(posed, edges, now.t),
        "jumps": _jumps(edges, sigma),
        "boundary": _boundary(edges, sigma, surface_forces(posed, edges, now)),
        "stabilisation": stabilised(posed, now.u),
        "data": unseen + work / CONSTANT**2,
    }
    return {name: CONSTANT**2 * squares for name, squares in parts.items()}


def _volume(posed: PosedScene, edges: Skeleton, t: float) -> Floats:
    """h^2 / mu |f|^2_K with the mean force: F = |K| f, so it is |F|^2 / mu with h^2 = |K|."""
    force = np.zeros((len(edges.sizes), 2))
    for load in posed.loads:
        if not isinstance(load, InitialStresses) and load.cells is not None:
            np.add.at(force, load.cells, load.forces(t))
    squared: Floats = np.einsum("cd,cd->c", force, force)
    return squared / edges.shear


def _jumps(edges: Skeleton, sigma: Floats) -> Floats:
    one, two = edges.inside.T
    jump = _traction(sigma[one] - sigma[two], edges.inside_normals)
    length = np.linalg.norm(edges.inside_normals, axis=1)
    h = 0.5 * (edges.sizes[one] + edges.sizes[two])
    mu = 0.5 * (edges.shear[one] + edges.shear[two])
    part = h / (4.0 * mu) * np.einsum("ed,ed->e", jump, jump) / length
    return totals(edges.inside.ravel(), np.repeat(0.5 * part, 2), len(sigma))


def _boundary(edges: Skeleton, sigma: Floats, force: Floats) -> Floats:
    stress = _traction(sigma[edges.outer], edges.outer_normals)
    rest = force + edges.joints.normal_forces(stress, edges.weights, edges.units) - stress
    rest = np.einsum("bij,bj->bi", edges.free, rest)
    part = edges.weights * np.einsum("bd,bd->b", rest, rest) / edges.lengths
    return totals(edges.outer, part, len(sigma))


def _traction(sigma: Floats, normals: Floats) -> Floats:
    xx, yy, xy = sigma.T
    x, y = normals.T
    return np.column_stack([xx * x + xy * y, xy * x + yy * y])


def stabilised(posed: PosedScene, u: Floats) -> Floats:
    """tau |(I - Pi) u|^2 (n_cells,), which the energy u'A u includes."""
    return posed.material.tau * missed_squares(posed.space, u)
