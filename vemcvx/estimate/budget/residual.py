"""Residual indicators of one state, cell by cell.

    eta_K^2 = c^2 (  h_K^2 / (9 mu) |f|^2_K                                          what the body force leaves
                   + sum over inner edges     d_e / (4 mu) |[sigma n]|^2_e / 2       jumps, half to each neighbour
                   + sum over boundary edges  d_e / (2 mu) |t - sigma n|^2_e )       loads, friction, contact, springs
              + the larger of
                     tau |(I - Pi) u|^2 at the vertices                              the stabilisation, as in K
                     sum over edges  d_e E / 6 |eps_ss(u) - eps_ss(Pi u)|^2_e        strain along edges
              + what of the data was not assembled                                   :mod:`.data_oscillation`

with sigma = C eps(Pi u) + sigma_0, E the modulus of a bar along the edge, and boundary residuals only in the directions
that supports leave free, at interfaces on the edges of both bodies (:mod:`.joints`). In the order of Verfurth,
*A Posteriori Error Estimation Techniques for Finite Element Methods* (2013), and of Cangiani, Georgoulis, Pryer and
Sutton, *A posteriori error estimates for the virtual element method* (Numer. Math. 137, 2017). A ninth is
of the Poincare inequality on a cell; c is declared below.

Lengths are those of the cell *across* the edge. A residual at e is tested with w = v - v_I, and the divergence of
(x - a) w^2 in the triangle T of e, the apex a and the height d gives

    |w|^2_e = 2 / d ( |w|^2_T + int_T w (x - a) . grad w )  <=  C d |grad w|^2_T     where |w|_T <= C d |grad w|_T,

as it is in meshes that are fine where things change fast. For d serves d_e, the side along n_e of the rectangle with
the cell's second moments (the mean of both cells), and for h_K its longer side: of a rectangle these are its sides, of
a triangle .82 of its heights, and short edges have no d_e beyond the diameter. A stress that varies along a cell of the
sides L and H jumps across its *short* edges by L d(sigma)/dx; with |K|^{1/2} for d this counted (H / L)^{1/2} of its
square, and estimates were .49 of the error on README's scene with 128 x 4 squares.

Tractions tell nothing of eps_ss, the strain along an edge. That of u is the same from both sides; what Pi u makes of it
differs, and this is the rest of the strain's variation, H d(eps_xx)/dy and L d(eps_yy)/dx. The stabilisation reads
it with the weight H L for both, and misses L / H of the latter. A strain of the bar E that is linear between two edges
e of a rectangle is a sixth of the sum over them.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, totals
from vemcvx.estimate.budget.data_oscillation import POINCARE, DataOscillation
from vemcvx.estimate.budget.skeleton import Skeleton
from vemcvx.estimate.budget.surface_forces import Instant, surface_forces
from vemcvx.meshes.polygons.segments import right_of
from vemcvx.scene.composition import InitialStresses
from vemcvx.scene.pose import PosedScene
from vemcvx.vem import elastic_matrix, strains, stresses
from vemcvx.vem.stabilisation import missed_squares

CONSTANT = 0.63
"""c, of the residuals alone: what the projection misses and data count by their own energy.

Measured with estimates over true errors of the declared family (tests/shared/declared_cells.py: blocks with friction,
sheared and under weight, and beams, on squares of the aspects 1 to 100 and all other families of 1 to 16, both ways):
1.04 to 3.6, in the median 1.45. On manufactured full slip, for Poisson's ratios up to .4999995, they are 1.2 to 4.0 and
1.8, on the paper's scene 1.2 to 1.6 and 1.3."""


def indicators(posed: PosedScene, edges: Skeleton, oscillation: DataOscillation, now: Instant) -> dict[str, Floats]:
    """Squares (n_cells,) of the parts "volume", "jumps", "boundary", "stabilisation" and "data" of eta_K."""
    strain = strains(posed.space, now.u)
    sigma = stresses(posed.material.moduli, strain)
    if posed.prestress is not None:
        sigma = sigma + posed.prestress.stress(now.t)
    missed = np.maximum(stabilised(posed, now.u), _along(posed, edges, now.u, strain))
    return {
        "volume": CONSTANT**2 * POINCARE * _volume(posed, edges, now.t),
        "jumps": CONSTANT**2 * _jumps(edges, sigma),
        "boundary": CONSTANT**2 * _boundary(edges, sigma, surface_forces(posed, edges, now)),
        "stabilisation": missed,
        "data": oscillation.squares(now, strain),
    }


def _volume(posed: PosedScene, edges: Skeleton, t: float) -> Floats:
    """h^2 / mu |f|^2_K with the mean force: F = |K| f."""
    force = np.zeros((len(edges.shear), 2))
    for load in posed.loads:
        if not isinstance(load, InitialStresses) and load.cells is not None:
            np.add.at(force, load.cells, load.forces(t))
    squared: Floats = np.einsum("cd,cd->c", force, force)
    return edges.sizes**2 / edges.areas * squared / edges.shear


def _jumps(edges: Skeleton, sigma: Floats) -> Floats:
    one, two = edges.inside.T
    jump = _traction(sigma[one] - sigma[two], edges.inside_normals)
    length = np.linalg.norm(edges.inside_normals, axis=1)
    d = 0.5 * (edges.depths(one, edges.inside_normals) + edges.depths(two, edges.inside_normals))
    mu = 0.5 * (edges.shear[one] + edges.shear[two])
    part = d / (4.0 * mu) * np.einsum("ed,ed->e", jump, jump) / length
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


def _along(posed: PosedScene, edges: Skeleton, u: Floats, strain: Floats) -> Floats:
    """d_e E / 6 |eps_ss(u) - eps_ss(Pi u)|^2_e, added up over the edges of each cell."""
    sides, owner = edges.sides, edges.owner
    along = np.diff(posed.space.mesh.points[sides], axis=1)[:, 0]
    length = np.linalg.norm(along, axis=1)
    x, y = (along / length[:, None]).T
    dyad = np.column_stack([x * x, y * y, x * y])
    moved = np.einsum("ed,ed->e", np.diff(u[sides], axis=1)[:, 0], along) / length**2
    missed = moved - np.einsum("ek,ek->e", dyad, strain[owner])
    compliance = np.linalg.inv(elastic_matrix(posed.material.moduli))[owner]
    young = 1.0 / np.einsum("ei,eij,ej->e", dyad, compliance, dyad)
    part = edges.depths(owner, right_of(along)) * young / 6.0 * missed**2 * length
    return totals(owner, part, len(strain))
