"""Fans of polygons: stresses in equilibrium with given forces, and conforming displacements."""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from scipy.linalg import eigh
from skfem.helpers import ddot, div, dot, grad, sym_grad

import vemcvx as vx
from vemcvx.bound.body_force import inf_sup_squares, missed_forces, oscillation_constants
from vemcvx.bound.displacement import SLOPES, VALUES, fan_displacement, strains_at_stations
from vemcvx.bound.fan import CORNERS, LINEAR_MASS_INVERSE, MASS, PARTS, RULE, RULE_WEIGHTS, STATIONS, fans_of
from vemcvx.bound.stress import (
    PARABOLAS,
    VOIGT,
    fan_stress,
    lifted,
    of_parabolas,
    reference,
)
from vemcvx.vem import Space, elastic_matrix

GRADIENT = np.array([[1.0, 2.0], [0.3, -0.5]])
STRAIN = np.array([1.0, -0.5, 2.3])


def fans(family="voronoi", lam=1.5):
    mesh = vx.meshes.FAMILIES[family](6)
    return fans_of(Space(mesh), elastic_matrix(np.stack([np.full(mesh.n_cells, lam), np.ones(mesh.n_cells)])))


def balanced(seed=0):
    """Forces of tractions on a reference triangle (3, 2, 2) and in it (3, 2), in balance."""
    ends = [CORNERS[k] for edge in range(3) for k in (edge, (edge + 1) % 3)]
    x = np.array([*ends, *CORNERS])
    rows = np.zeros((3, 9, 2))
    rows[0, :, 0] = rows[1, :, 1] = 1.0
    rows[2] = np.column_stack([-x[:, 1], x[:, 0]])
    return np.linalg.svd(rows.reshape(3, 18))[2][3:].T @ np.random.default_rng(seed).normal(size=15)


def polynomial(points, values):
    """Coefficients (6, ...) of a polynomial of degree 2 by its values (6, ...) at points (6, 2)."""
    x, y = points.T
    return np.linalg.solve(np.column_stack([np.ones(6), x, y, x * x, x * y, y * y]), values)


def slopes(points, c):
    """Its derivatives along x and y (q, ...) at points (q, 2)."""
    x, y = points.T
    return (
        np.tensordot(np.column_stack([0 * x, 1 + 0 * x, 0 * x, 2 * x, y, 0 * x]), c, 1),
        np.tensordot(np.column_stack([0 * x, 0 * x, 1 + 0 * x, 0 * x, x, 2 * y]), c, 1),
    )


@pytest.mark.parametrize("seed", range(3))
def test_reference_stress_balances_linear_body_forces_at_every_point(seed):
    data = balanced(seed)
    tau, density = (reference() @ data).reshape(3, 6, 3), LINEAR_MASS_INVERSE @ data[12:].reshape(3, 2)
    for points, values in zip(STATIONS, tau, strict=True):
        along_x, along_y = slopes(points, polynomial(points, values))
        divergence = np.column_stack([along_x[:, 0] + along_y[:, 2], along_x[:, 2] + along_y[:, 1]])
        corners = np.column_stack([1 - points.sum(axis=1), points])
        assert np.abs(divergence + corners @ density).max() < 1e-11


@pytest.mark.parametrize("seed", range(3))
def test_reference_stress_has_the_given_tractions_and_passes_them_on_across_inner_edges(seed):
    data = balanced(seed)
    tau = np.einsum("abk,pqk->pqab", VOIGT, (reference() @ data).reshape(3, 6, 3))
    forces, centre = data[:12].reshape(3, 2, 2), CORNERS.mean(axis=0)
    for k, (one, other, _) in enumerate(PARTS):
        along = CORNERS[other] - CORNERS[one]
        traction = tau[k][[0, 1, 3]] @ [along[1], -along[0]]
        first, last = 4 * forces[k, 0] - 2 * forces[k, 1], 4 * forces[k, 1] - 2 * forces[k, 0]
        assert np.abs(traction - [first, last, 0.5 * (first + last)]).max() < 1e-12
        inward = centre - CORNERS[one]
        normal = np.array([inward[1], -inward[0]])
        # Stations from the corner to the centroid: of this part 0, 5, 2, of the one before 1, 4, 2.
        assert np.abs((tau[k][[0, 5, 2]] - tau[k - 1][[1, 4, 2]]) @ normal).max() < 1e-12


def edge_motion(one, field):
    """(c, 4 n) a field x -> u at both ends of the outer edges."""
    return np.stack([field(one.corners), field(np.roll(one.corners, -1, axis=1))], axis=2).reshape(len(one.cells), -1)


def test_motion_of_a_constant_strain_makes_its_stress_with_its_energy(family):
    for one in fans(family):
        c, n = one.corners.shape[:2]
        motion, made = edge_motion(one, lambda x: x @ GRADIENT.T), fan_stress(one)
        stress = np.einsum("ckl,l->ck", one.C, STRAIN)
        found = made.at_stations(motion, np.zeros((c, 6 * n)))
        assert np.abs(found - stress[:, None, None]).max() < 1e-10
        energy = np.sum(motion * one.apply(made.stiffness, motion), axis=1)
        assert np.allclose(energy, stress @ STRAIN * 0.5 * one.doubled_areas.sum(axis=1), rtol=1e-10)


def test_rigid_motion_makes_no_stress(family):
    for one in fans(family):
        motion = edge_motion(one, lambda x: np.stack([1.0 - x[..., 1], 2.0 + x[..., 0]], axis=-1))
        made, size = fan_stress(one), np.sqrt(one.doubled_areas.min())
        assert np.abs(one.apply(made.stiffness, motion)).max() < 1e-11
        assert size * np.abs(made.at_stations(motion, np.zeros((len(motion), 6 * one.n)))).max() < 1e-11


def energies(one, made, motion, force):
    """(c,) |tau|^2 in C^-1 of the stress itself, by quadrature."""
    c, n = one.corners.shape[:2]
    tau = made.at_stations(motion, force)
    of_rule = np.einsum("pqi,ctpik->ctpqk", lagrange(), tau.reshape(c, n, 3, 6, 3)).reshape(c, n, 21, 3)
    density = np.einsum("ctqk,ckl,ctql->ctq", of_rule, np.linalg.inv(one.C), of_rule)
    return np.einsum("q,ctq,ct->c", RULE_WEIGHTS, density, one.doubled_areas)


def test_stress_has_the_least_energy_under_its_forces():
    """E(m) = m . G m, and stresses of motions are orthogonal to that of a body force: E / 2 - m . b is least."""
    rng = np.random.default_rng(0)
    for one in fans():
        c, n = one.corners.shape[:2]
        made, none, still = fan_stress(one), np.zeros((c, 6 * n)), np.zeros((c, 4 * n))
        motion, force = rng.normal(size=(c, 4 * n)), rng.normal(size=(c, 6 * n))
        own = energies(one, made, motion, none)
        assert np.allclose(own, np.sum(motion * one.apply(made.stiffness, motion), axis=1), rtol=1e-9)
        both = energies(one, made, motion, force)
        of_force = energies(one, made, still, force)
        assert np.allclose(both, own + of_force, rtol=1e-9)


def lagrange():
    """(3, 7, 6) the Lagrange functions of each part at the points of the rule."""
    return np.stack([values_of(points, at) for points, at in zip(STATIONS, RULE, strict=True)])


def values_of(points, at):
    x, y = at.T
    return np.column_stack([np.ones(len(at)), x, y, x * x, x * y, y * y]) @ polynomial(points, np.eye(6))


def strain_lost(family, lam):
    """The largest error of the strains inside, of a linear displacement."""
    lost = 0.0
    for one in fans(family, lam):
        c, n = one.corners.shape[:2]
        middles = 0.5 * (one.corners + np.roll(one.corners, -1, axis=1))
        outline = np.concatenate([one.corners @ GRADIENT.T, middles @ GRADIENT.T], axis=1).reshape(c, 4 * n)
        v = fan_displacement(one).nodal(outline, np.zeros((c, 6 * n)))
        lost = max(lost, np.abs(strains_at_stations(one, v) - STRAIN).max())
    return lost


def test_linear_displacement_is_reproduced_inside(family):
    assert strain_lost(family, 1.5) < 1e-11


def test_linear_displacement_is_reproduced_inside_nearly_incompressible_cells(family):
    """Rounding is a millionth of a millionth of the energy: lambda times the square of what strains are off."""
    lam = 1e6
    assert lam * strain_lost(family, lam) ** 2 < 1e-9


def forces_of(one, sigma):
    """(c, n, 20) int sigma : eps(phi) of stresses (c, n, 18, 3) at the stations."""
    c, n = sigma.shape[:2]
    weighed = np.einsum("ij,ctpjk->ctpik", MASS, sigma.reshape(c, n, 3, 6, 3)).reshape(c, n, 18, 3)
    tensor = (weighed * one.doubled_areas[..., None, None])[..., [[0, 2], [2, 1]]]
    return np.einsum("ctar,ctqrd,qak->ctkd", one.back, tensor, SLOPES, optimize=True).reshape(c, n, 20)


def test_forces_of_a_stress_do_the_work_of_its_energy(family):
    rng = np.random.default_rng(1)
    for one in fans(family):
        made, none = fan_displacement(one), np.zeros((len(one.cells), 6 * one.n))
        outline = rng.normal(size=(len(one.cells), 4 * one.n))
        strain = strains_at_stations(one, made.nodal(outline, none))
        found = made.on_outline(forces_of(one, np.einsum("ctqk,ckl->ctql", strain, one.C)))
        assert np.allclose(found, one.apply(made.stiffness, outline), atol=1e-10 * np.abs(found).max())


def test_parabolas_are_balanced_by_their_stress():
    """The norm of the lifting bounds the work of a parabola, and some displacement has half of it at least."""
    one = fans("squares")[0]
    rule = RULE.reshape(-1, 2)
    bent = (
        np.column_stack([0 * rule[:, 0] + 1, *rule.T, rule[:, 0] ** 2, rule.prod(axis=1), rule[:, 1] ** 2]) @ PARABOLAS
    )
    rng, (c, n) = np.random.default_rng(2), one.corners.shape[:2]
    alpha = rng.normal(size=(c, n, 3, 2))
    norm = lifted(one, of_parabolas(), one.doubled_areas[..., None, None] * alpha)
    loads = np.einsum("q,qi,ctid,qj,ct->ctjd", RULE_WEIGHTS, bent, alpha, VALUES, one.doubled_areas, optimize=True)
    K = np.stack([forces_of(one, np.einsum("ctqk,ckl->ctql", strains_at_stations(one, v), one.C)) for v in unit(c, n)])
    work = loads.reshape(c, n, 20)
    for cell, t in ((0, 0), (c - 1, 1)):
        A = K[:, cell, t]
        largest = np.sqrt(work[cell, t] @ np.linalg.pinv(A, rcond=1e-10) @ work[cell, t])
        assert 0.5 * norm[cell, t] <= largest <= norm[cell, t]


def cubics(x):
    """Monomials (q, 10) up to degree 3."""
    return np.column_stack([x[:, 0] ** (k - j) * x[:, 1] ** j for k in range(4) for j in range(k + 1)])


def test_what_is_missed_of_cubic_forces_is_integrated_exactly():
    """The square of what is left is of degree 6, and the rule of degree 5: it took .63 to .98 of these squares."""
    points, weights = np.polynomial.legendre.leggauss(4)
    a, b = (0.5 + 0.5 * one.ravel() for one in np.meshgrid(points, points))
    exact, weights = np.column_stack([a, b * (1.0 - a)]), 0.25 * np.outer(weights, weights).ravel() * (1.0 - a)
    f = np.random.default_rng(3).normal(size=(10, 2))
    values, half = cubics(exact) @ f, np.sqrt(weights)[:, None]
    left = half * values - half * (
        cubics(exact)[:, :6] @ np.linalg.lstsq(half * cubics(exact)[:, :6], half * values)[0]
    )
    missed = missed_forces((cubics(RULE.reshape(-1, 2)) @ f)[None, None])[1]
    # A mean is twice the integral over the reference triangle.
    assert np.isclose(missed[0, 0], 2.0 * np.sum(left**2), rtol=1e-9)


def unit(c, n):
    """Nodal values (c, n, 20), one at a time."""
    for k in range(20):
        v = np.zeros((c, n, 20))
        v[..., k] = 1.0
        yield v


def test_a_cell_that_no_point_sees_is_refused():
    comb = [(0, 0), (5, 0), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]
    mesh = vx.PolygonMesh(comb, [range(12)])
    with pytest.raises(vx.SceneError, match="no point sees all of cell 0"):
        fans_of(Space(mesh), elastic_matrix(np.ones((2, 1))))


def test_short_edges_are_refused():
    mesh = vx.PolygonMesh([(0, 0), (1, 0), (1, 1), (1e-4, 1), (0, 1)], [range(5)])
    with pytest.raises(vx.SceneError, match="Merge its nodes"):
        fans_of(Space(mesh), elastic_matrix(np.ones((2, 1))))


@skfem.BilinearForm
def gradients(u, v, w):
    return ddot(sym_grad(u), sym_grad(v))


@skfem.BilinearForm
def masses(u, v, w):
    return dot(u, v)


@skfem.BilinearForm
def all_slopes(u, v, w):
    return ddot(grad(u), grad(v))


@skfem.BilinearForm
def divergences(u, q, w):
    return div(u) * q


@skfem.BilinearForm
def squares(p, q, w):
    return p * q


@pytest.mark.parametrize("seed", range(4))
def test_inf_sup_constants_are_below_eigenvalues(seed):
    """beta^2 of Taylor's and Hood's elements on a fine mesh of a triangle: the least eigenvalue but zero."""
    angles = np.random.default_rng(seed).dirichlet(np.full(5, 3.0)).cumsum() * 2.0 * np.pi
    mesh = vx.PolygonMesh(np.column_stack([np.cos(angles), 0.6 * np.sin(angles)]), [range(5)])
    one = fans_of(Space(mesh), elastic_matrix(np.array([[0.0], [0.5]])))[0]
    for t, bound in enumerate(inf_sup_squares(one)[0]):
        corners = np.concatenate([[[0.0, 0.0]], one.corners[0, [t, (t + 1) % 5]]])
        triangle = skfem.MeshTri(corners.T.copy(), np.array([[0], [1], [2]])).refined(3)
        V = skfem.Basis(triangle, skfem.ElementVector(skfem.ElementTriP2()), intorder=4)
        Q = skfem.Basis(triangle, skfem.ElementTriP1(), intorder=4)
        inside = V.complement_dofs(V.get_dofs())
        A, B = all_slopes.assemble(V).toarray()[np.ix_(inside, inside)], divergences.assemble(V, Q).toarray()[:, inside]
        found = eigh(B @ np.linalg.solve(A, B.T), squares.assemble(Q).toarray(), eigvals_only=True)
        assert abs(found[0]) < 1e-12  # Constants have no divergence.
        assert bound <= found[1] <= 3.0 * bound


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_oscillation_constants_bound_what_moves_without_straining(seed):
    """|w|_T and |w|_e of all quadratic w on a fine mesh of a triangle, less rigid motions, by their energy."""
    angles = np.random.default_rng(seed).dirichlet(np.full(3, 3.0)).cumsum() * 2.0 * np.pi
    mesh = vx.PolygonMesh(np.column_stack([np.cos(angles), np.sin(angles)]), [range(3)])
    one = fans_of(Space(mesh), elastic_matrix(np.array([[0.0], [0.5]])))[0]
    inside, outside = oscillation_constants(one)
    for t in range(3):
        corners = np.concatenate([[[0.0, 0.0]], one.corners[0, [t, (t + 1) % 3]]])
        triangle = skfem.MeshTri(corners.T.copy(), np.array([[0], [1], [2]])).refined(3)
        basis = skfem.Basis(triangle, skfem.ElementVector(skfem.ElementTriP2()))
        # The outer edge is where the first two of the reference coordinates add up to one.
        far = np.linalg.solve(corners[1:].T, triangle.p).sum(axis=0) > 1.0 - 1e-12
        edge = np.flatnonzero(far[triangle.facets].all(axis=0))
        facets = skfem.FacetBasis(triangle, basis.elem, facets=edge)
        K, M, B = gradients.assemble(basis), masses.assemble(basis), masses.assemble(facets)
        # To be orthogonal to rigid motions is what data allow; it is in the mean over T that w may be chosen so.
        x = basis.doflocs
        first = np.zeros(basis.N)
        rigid = np.stack([first] * 3, axis=1)
        of_x, of_y = (basis.get_dofs(elements=True).all([name]) for name in ("u^1", "u^2"))
        rigid[of_x, 0] = rigid[of_y, 1] = 1.0
        rigid[of_x, 2], rigid[of_y, 2] = -x[1, of_x], x[0, of_y]
        for form, constant in ((M, inside[0, t]), (B, outside[0, t])):
            A = form.toarray()
            # The least over rigid motions of A's form.
            part = A @ rigid @ np.linalg.pinv(rigid.T @ A @ rigid) @ rigid.T @ A
            values = np.linalg.eigvals(np.linalg.pinv(K.toarray(), rcond=1e-10) @ (A - part)).real
            assert np.sqrt(values.max()) <= constant
            assert np.sqrt(values.max()) >= 0.02 * constant
