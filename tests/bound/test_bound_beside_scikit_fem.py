"""Bounds compared with solutions by scikit-fem and cvxpy.

Let u be the exact solution, v the displacement whose error is bounded, w the solution of scikit-fem on quadratic
elements, and J the functional that u minimises. Both v and w are quadratic on the triangles of the mesh of w, so that
|w - v|_a is integrated exactly. Triangles are refined towards points where stresses are singular.

The displacement w is admissible, because the Bernstein coefficients of the normal displacement are >= 0 on the floor.
So J(w) >= J(u) and |w - u|_a^2 <= 2 (J(w) - J(u)). Let w_1 be the solution on the next coarser mesh. If
J(w_1) - J(w) >= J(w) - J(u), then |w - u|_a^2 <= 2 (J(w_1) - J(w)).
"""

from __future__ import annotations

from dataclasses import dataclass

import cvxpy as cp
import numpy as np
import pytest
import scipy.sparse.linalg as spla
import skfem
from bounds import circle_of, strain_at
from scenes import paper_scene, small
from skfem.helpers import dot
from skfem.models.elasticity import lame_parameters, linear_elasticity

import vemcvx as vx

YOUNG, POISSON = 200.0, 0.3
GAUSS, WEIGHTS = np.array(np.polynomial.legendre.leggauss(3)) / 2.0 + [[0.5], [0.0]]
"""Quadrature points and weights on an edge, for friction in cvxpy."""
FINE, FINE_WEIGHTS = np.array(np.polynomial.legendre.leggauss(24)) / 2.0 + [[0.5], [0.0]]
"""Quadrature points and weights on an edge, for friction in J."""


@dataclass(frozen=True)
class Case:
    """A body on the floor y = 0, with a clamp, a load, friction and singular points."""

    scene: vx.Scene
    clamped: tuple[int, float]
    """Axis and coordinate of the clamped side."""
    loaded: tuple[int, float]
    load: object
    """The traction: a function of points that returns two components."""
    friction: float
    can_lift: bool
    """True if the body can lift off the floor."""
    singular: tuple[tuple[float, float], ...]


PAPER = Case(
    scene=paper_scene(),
    clamped=(0, 1.0),
    loaded=(0, 0.0),
    load=lambda x: (8.0 * (1.25 - x[1]), -0.01 + 0.0 * x[0]),
    friction=4.0,
    can_lift=False,
    singular=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)),
)
LIFT = 0.5
BRACKET = Case(
    scene=vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.Clamp(on="top"),
        vx.Traction(lambda x, t: np.tile([2.0 * t, LIFT * t], (len(x), 1)), on="right"),
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(0.6, on="bottom", while_closed=False),
    ),
    clamped=(1, 1.0),
    loaded=(0, 1.0),
    load=lambda x: (2.0 + 0.0 * x[0], LIFT + 0.0 * x[0]),
    friction=0.6,
    can_lift=True,
    singular=((0.5, 0.5), (0.0, 1.0), (0.5, 1.0), (0.0, 0.0), (1.0, 0.0)),
)


def fan_triangles(circle):
    """Return a mesh of the triangles on which v is quadratic."""
    corners = []
    for fans in (one.fans for one in circle.forms):
        here = fans.corners + fans.centres[:, None]
        ahead, centre = np.roll(here, -1, axis=1), np.broadcast_to(fans.centres[:, None], here.shape)
        middle = (here + ahead + centre) / 3.0
        for one, two in ((here, ahead), (ahead, centre), (centre, here)):
            corners.append(np.stack([one, two, middle], axis=2).reshape(-1, 3, 2))
    points = np.concatenate(corners).reshape(-1, 2)
    _, first, number = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    return skfem.MeshTri(points[first].T.copy(), number.reshape(-1, 3).T.copy())


def refine_around(mesh, points, levels):
    """Return the mesh after repeated refinement around points."""
    for level in range(levels):
        middle = mesh.p[:, mesh.t].mean(axis=1)
        radius = 0.15 * 0.5**level
        near = [np.linalg.norm(middle - np.reshape(point, (2, 1)), axis=0) < radius for point in points]
        mesh = mesh.refined(np.flatnonzero(np.any(near, axis=0)))
    return mesh


def shapes(s):
    """Return the three quadratic shape functions of an edge at points s."""
    return np.column_stack([(1.0 - s) * (1.0 - 2.0 * s), s * (2.0 * s - 1.0), 4.0 * s * (1.0 - s)])


@dataclass(frozen=True)
class Solution:
    """The minimiser w of J, the value J(w), and the energy of w."""

    basis: skfem.Basis
    w: np.ndarray
    J: float
    energy: float
    floor: np.ndarray
    """Displacements (edges, 3, 2) of both ends and the middle of edges on the floor."""
    along: np.ndarray
    """Coordinates x of both ends of the edges on the floor."""


def solve_with_cvxpy(case, mesh):
    """Return the minimiser of J over quadratic elements, with friction at three points of each edge."""
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP2()), intorder=4)
    K = linear_elasticity(*lame_parameters(YOUNG, POISSON)).assemble(basis).tocsc()

    def on(axis, value):
        return mesh.facets_satisfying(lambda x: np.abs(x[axis] - value) < 1e-9, boundaries_only=True)

    side = skfem.FacetBasis(mesh, basis.elem, facets=on(*case.loaded), intorder=6)
    f = skfem.LinearForm(lambda v, w: dot(np.stack(case.load(w.x)), v)).assemble(side)

    edges = on(1, 0.0)
    ends = mesh.facets[:, edges]
    dofs = np.stack([basis.nodal_dofs[:, ends[0]], basis.nodal_dofs[:, ends[1]], basis.facet_dofs[:, edges]])
    # dofs[k, component, edge], where k is an end (0, 1) or the middle (2).
    along = mesh.p[0, ends].T
    lengths = np.abs(along[:, 1] - along[:, 0])
    held = basis.get_dofs(on(*case.clamped)).all()
    if not case.can_lift:  # vertical displacements on the floor are zero
        held = np.union1d(held, dofs[:, 1])
    contact = np.setdiff1d(dofs, held)
    rest = np.setdiff1d(np.arange(len(f)), np.union1d(held, contact))
    # A Schur complement eliminates all unknowns that are not on the floor.
    inner = spla.splu(K[rest][:, rest])
    coupling = K[rest][:, contact].toarray()
    back = inner.solve(np.column_stack([coupling, f[rest]]))
    S = K[contact][:, contact].toarray() - coupling.T @ back[:, :-1]
    right = f[contact] - coupling.T @ back[:, -1]

    column = np.full(len(f), -1)
    column[contact] = np.arange(len(contact))

    def rows(weights, component):
        """Return the matrix from unknowns on the floor to weighted sums of the three values on an edge."""
        out = np.zeros((len(weights), len(edges), len(contact)))
        for k in range(3):
            free = np.flatnonzero(column[dofs[k, component]] >= 0)
            out[:, free, column[dofs[k, component][free]]] += weights[:, k, None]
        return out.reshape(-1, len(contact))

    slips, costs = rows(shapes(GAUSS), 0), case.friction * np.outer(WEIGHTS, lengths).ravel()
    size = np.abs(S).max()
    root = np.linalg.cholesky(0.5 * (S + S.T) / size).T
    unit = np.abs(np.linalg.solve(S, right)).max()
    y = cp.Variable(len(contact))
    cost = 0.5 * cp.sum_squares(root @ y) - (right / size / unit) @ y + (costs / size / unit) @ cp.abs(slips @ y)
    bernstein = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-0.5, -0.5, 2.0]])
    above = [rows(bernstein, 1) @ y >= 0] if case.can_lift else []
    tolerances = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), 1e-11)
    cp.Problem(cp.Minimize(cost), above).solve(solver=cp.CLARABEL, **tolerances)

    w = np.zeros(len(f))
    w[contact] = unit * y.value
    w[rest] = back[:, -1] - back[:, :-1] @ w[contact]
    floor = w[dofs].transpose(2, 0, 1)
    friction = case.friction * float(np.abs(shapes(FINE) @ floor[..., 0].T).T @ FINE_WEIGHTS @ lengths)
    energy = 0.5 * float(w @ (K @ w))
    return Solution(basis, w, energy - float(f @ w) + friction, energy, floor, along)


def find_changes(found, size):
    """Return the points of the floor at which slip or lift-off begins or ends."""
    order = np.argsort(found.along.min(axis=1))
    at, values = found.along.min(axis=1)[order], found.floor[order, 2]
    moves = np.abs(values) > 1e-6 * size
    places = [at[1:][one[1:] != one[:-1]] for one in moves.T]
    return [(float(x), 0.0) for x in np.unique(np.concatenate(places))]


def distance(found, circle, u):
    """Return |w - v|_a."""
    grad = found.basis.interpolate(found.w).grad
    strain = np.stack([grad[0, 0], grad[1, 1], grad[0, 1] + grad[1, 0]], axis=-1)
    x = np.asarray(found.basis.global_coordinates())
    e = strain - strain_at(circle, u, 1.0, x.reshape(2, -1).T).reshape(strain.shape)
    lam, mu = lame_parameters(YOUNG, POISSON)
    density = lam * (e[..., 0] + e[..., 1]) ** 2 + 2.0 * mu * (e[..., 0] ** 2 + e[..., 1] ** 2 + 0.5 * e[..., 2] ** 2)
    return float(np.sqrt(np.sum(density * found.basis.dx)))


CASES = {
    "paper on squares": (PAPER, lambda: vx.meshes.squares(4)),
    "paper on voronoi": (PAPER, lambda: small("voronoi", 4)),
    "bracket that lifts off its floor": (BRACKET, lambda: vx.meshes.l_shape(6)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_bounds_contain_the_solution_of_scikit_fem(name):
    case, mesh = CASES[name]
    history = vx.simulate(case.scene, mesh(), [0.0, 1.0])
    bound, circle, u = vx.error_bound(history, step=-1), circle_of(history), history.displacement[-1]
    first = solve_with_cvxpy(case, refine_around(fan_triangles(circle), case.singular, 4))
    points = [*case.singular, *find_changes(first, np.abs(u).max())]
    triangles = refine_around(fan_triangles(circle), points, 8)
    coarse, fine = (solve_with_cvxpy(case, one) for one in (triangles, triangles.refined()))
    own, error = np.sqrt(2.0 * (coarse.J - fine.J)), distance(fine, circle, u)
    assert own <= 0.08 * error
    assert error + own <= bound.upper
    assert bound.lower <= error + own
    assert bound.upper <= 1.25 * error
    assert bound.upper <= 1.5 * bound.lower
    assert bound.potential[0] <= fine.J <= bound.potential[1]
    assert bound.energy[0] <= fine.energy <= bound.energy[1]
