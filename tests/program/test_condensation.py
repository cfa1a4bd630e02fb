"""Static condensation against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from installed import needs
from scenes import paper_scene, small

import vemcvx as vx
from vemcvx.arrays import EPS
from vemcvx.linear import nested_dissection
from vemcvx.program.condensation import Condensation
from vemcvx.scene import pose_scene

pytestmark = pytest.mark.arithmetic
EACH = [vx.SuperLU(), pytest.param(vx.Pardiso(), marks=needs("pymklpardiso"))]
LINEAR = pytest.mark.parametrize("linear", EACH, ids=str)


def square(condensation, y_c, force):
    """y'Ky."""
    return force.work_inside(force) + y_c @ (condensation.operators.K @ y_c)


def work(phi, y_c, force):
    """phi'y, the work of the force phi on the state (y_c, force)."""
    return phi.work_inside(force) + phi.retained @ y_c


@pytest.fixture(params=["connected", "two bodies", "nothing touched", "everything touched"])
def system(request):
    rng = np.random.default_rng(0)
    n = 24
    A = np.where(rng.random((n, n)) < 0.15, rng.random((n, n)), 0.0)
    K = A @ A.T + np.eye(n)
    if request.param == "two bodies":
        K[:10, 10:] = K[10:, :10] = 0.0
    retained = {"nothing touched": [], "everything touched": list(range(n))}.get(request.param, [3, 20, 7, 15])
    norms = vx.Norms(np.eye(n)[retained], np.ones(len(retained))) if retained else None
    return vx.System(K, lambda t: np.full(n, t), norms)


@LINEAR
def test_schur_complement_and_recovery(system, linear):
    K = system.K.toarray()
    condensation = Condensation(system, linear=linear)
    c = condensation.retained
    i = np.setdiff1d(np.arange(system.n), c)
    S = K[np.ix_(c, c)] - K[np.ix_(c, i)] @ np.linalg.solve(K[np.ix_(i, i)], K[np.ix_(i, c)]) if len(i) else K
    assert np.allclose(condensation.operators.K, S, rtol=0, atol=1e-13 * np.abs(K).max())
    rng = np.random.default_rng(1)
    f, phi, y_c = rng.normal(size=system.n), rng.normal(size=system.n), rng.normal(size=len(c))
    y = np.zeros(system.n)
    y[c] = y_c
    y[i] = np.linalg.solve(K[np.ix_(i, i)], f[i] - K[np.ix_(i, c)] @ y_c)
    force, other = condensation.reduce(f), condensation.reduce(phi)
    tolerance = 1e-13 * np.linalg.cond(K) * np.abs(y).max()
    assert np.allclose(condensation.recover(y_c, force), y, rtol=0, atol=tolerance)
    assert square(condensation, y_c, force) == pytest.approx(y @ K @ y, rel=1e-11)
    assert work(other, y_c, force) == pytest.approx(phi @ y, abs=1e-11 * np.abs(phi).sum())
    reduced = f[c] - K[np.ix_(c, i)] @ np.linalg.solve(K[np.ix_(i, i)], f[i]) if len(i) else f
    assert np.allclose(force.retained, reduced, rtol=0, atol=1e-12 * np.abs(f).max())


@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")
@LINEAR
@pytest.mark.parametrize("n", [4, 12])
def test_rigid_motions_do_not_become_strain(n, linear):
    """A block that nothing but its floor holds, moved far: inside, forces balance to the rounding of their parts."""
    press = vx.Traction((0.0, -2.0), on="top")
    floor = vx.UnilateralContact(on="bottom"), vx.TrescaFriction(bound=1.0, on="bottom")
    system = pose_scene(vx.Scene(vx.Elasticity(young=200.0, poisson=0.3), press, *floor), vx.meshes.squares(n)).system
    condensation, f = Condensation(system, linear=linear), system.force(1.0)
    c = condensation.retained
    y_c = 1e-3 * np.random.default_rng(0).normal(size=len(c)) + system.kernel.modes[c] @ [3.0, -2.0, 1.0]
    y = condensation.recover(y_c, condensation.reduce(f))
    inside = np.setdiff1d(np.arange(system.n), c)
    left = np.abs(f - system.K @ y)[inside]
    # The unknowns that meet at a node, 18, are rounded once each; as many products are summed.
    parts = (np.abs(f) + abs(system.K) @ np.abs(y))[inside]
    assert (y[c] == y_c).all()
    assert (left <= 18 * np.finfo(float).eps / 2 * parts).all()


@LINEAR
def test_energies_are_not_differences(system, linear):
    """The energy of a state under a force inside, whatever holds the touched unknowns where they are."""
    K, condensation = system.K.toarray(), Condensation(system, linear=linear)
    c = condensation.retained
    i = np.setdiff1d(np.arange(system.n), c)
    rng = np.random.default_rng(4)
    f, y = rng.normal(size=system.n), rng.normal(size=system.n)
    y[i] = np.linalg.solve(K[np.ix_(i, i)], f[i] - K[np.ix_(i, c)] @ y[c])
    assert square(condensation, y[c], condensation.reduce(f)) == pytest.approx(y @ K @ y, rel=1e-12)


def inside(system, condensation, phi):
    """K_ii^{-1} phi_i, zero on the touched unknowns, by dense algebra."""
    i = np.setdiff1d(np.arange(system.n), condensation.retained)
    held = np.zeros(system.n)
    held[i] = np.linalg.solve(system.K.toarray()[np.ix_(i, i)], phi[i])
    return held


def test_loads_that_are_combinations_cost_no_solve(system, monkeypatch):
    condensation = Condensation(system)
    rng = np.random.default_rng(2)
    one, two = rng.normal(size=(2, system.n))
    calls = []
    for factor in (condensation.factor, condensation.operators.factor):
        monkeypatch.setattr(factor, "solve", lambda b, solve=factor.solve: (calls.append(1), solve(b))[1])
    counts = []
    for a, b in [(1.0, 0.0), (0.3, 0.0), (0.5, 2.0), (-7.0, 1e-3), (0.0, 0.0)]:
        phi = a * one + b * two
        exact, held = np.linalg.solve(system.K.toarray(), phi), inside(system, condensation, phi)
        tolerance = 1e-12 * max(np.abs(exact).max(), 1e-300)
        reduced = condensation.reduce(phi)
        assert np.allclose(reduced.x, exact, rtol=0, atol=tolerance)
        still = np.zeros(len(condensation.retained))
        assert np.allclose(condensation.recover(still, reduced), held, rtol=0, atol=tolerance)
        counts.append(len(calls))
    assert counts[0] == counts[1] < counts[2] == counts[3] == counts[4]
    # One with the touched unknowns free, one or two with them held, and one for the touched ones alone.
    assert counts[2] <= 2 * 4


def test_loads_of_ever_new_shape_are_solved_for(system):
    condensation = Condensation(system)
    rng = np.random.default_rng(3)
    for _ in range(20):
        f = rng.normal(size=system.n)
        exact = inside(system, condensation, f)
        found = condensation.recover(np.zeros(len(condensation.retained)), condensation.reduce(f))
        assert np.allclose(found, exact, rtol=0, atol=1e-11 * max(np.abs(exact).max(), 1e-300))
        assert not found[condensation.retained].any()


def condensed(poisson):
    """The paper's body on a small mesh by SuperLU, and the pull on its left side."""
    elasticity = vx.Elasticity(200.0, poisson)
    system = pose_scene(paper_scene().without(vx.Elasticity).with_(elasticity), small("squares", 6)).system
    return Condensation(system, linear=vx.SuperLU()), system.force(1.0)


@pytest.mark.parametrize("poisson", [0.3, 0.4999999])
def test_states_and_works_are_those_of_dense_matrices(poisson):
    condensation, f = condensed(poisson)
    system, c, rng = condensation.system, condensation.retained, np.random.default_rng(5)
    force = condensation.reduce(f)
    K, y_c = system.K.toarray(), 1e-3 * rng.normal(size=len(c))
    i, phi = np.setdiff1d(np.arange(system.n), c), rng.normal(size=system.n)
    y = np.zeros(system.n)
    y[c], y[i] = y_c, np.linalg.solve(K[np.ix_(i, i)], f[i] - K[np.ix_(i, c)] @ y_c)
    rounding = np.linalg.cond(K) * EPS
    assert condensation.recover(y_c, force) == pytest.approx(y, rel=0, abs=rounding * np.abs(y).max())
    assert square(condensation, y_c, force) == pytest.approx(y @ K @ y, rel=rounding)
    other = condensation.reduce(phi)
    assert work(other, y_c, force) == pytest.approx(phi @ y, abs=rounding * (np.abs(phi) @ np.abs(y)))


def test_what_pulls_at_retained_unknowns_is_taken_off_before_it_is_solved_for():
    """Beside 1e6 times their pull that of the inside would lose twelve digits of its energy."""
    condensation, f = condensed(0.3)
    c = condensation.retained
    f[c] = 1e6 * np.random.default_rng(6).normal(size=len(c))
    force, K = condensation.reduce(f), condensation.system.K.toarray()
    xi = inside(condensation.system, condensation, f)
    energy = square(condensation, np.zeros(len(c)), force)
    assert energy == pytest.approx(xi @ K @ xi, rel=np.linalg.cond(K) * EPS)


def test_nested_dissection_is_a_permutation_with_less_fill_than_the_natural_order():
    n = 24
    points = np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2).astype(float)
    line = sp.diags_array([1.0, 1.0, 1.0], offsets=[-1, 0, 1], shape=(n, n))
    graph = sp.csr_matrix(sp.kron(line, line))
    order = nested_dissection(graph, points)
    assert np.array_equal(np.sort(order), np.arange(n * n))
    K = graph * -1.0 + sp.eye_array(n * n) * 20
    fill = [
        sp.linalg.splu(sp.csc_matrix(K[p][:, p]), permc_spec="NATURAL", diag_pivot_thresh=0.0).nnz
        for p in (np.arange(n * n), order)
    ]
    assert fill[1] < 0.8 * fill[0]
    # The first separator is a line across: nothing before it reads both halves.
    halves = order[: n * n // 2], order[n * n // 2 : -n]
    assert np.ptp(points[order[-n:]], axis=0).min() == 0
    assert graph[halves[0]][:, halves[1]].nnz == 0


@pytest.mark.parametrize("n", [0, 1, 9, 200])
def test_nested_dissection_takes_coincident_points(n):
    graph = sp.csr_matrix(np.ones((n, n)))
    assert np.array_equal(np.sort(nested_dissection(graph, np.zeros((n, 2)))), np.arange(n))


def test_nested_dissection_takes_points_of_which_most_are_on_one_side():
    points = np.column_stack([np.repeat([0.0, 1.0], [150, 50]), np.zeros(200)])
    graph = sp.csr_matrix(sp.diags_array([1.0, 1.0, 1.0], offsets=[-1, 0, 1], shape=(200, 200)))
    assert np.array_equal(np.sort(nested_dissection(graph, points)), np.arange(200))
