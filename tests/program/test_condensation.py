"""Runs on the unknowns of contact alone, beside the same runs on all unknowns and beside dense linear algebra."""

import numpy as np
import pytest
import scipy.sparse as sp
from installed import needs
from scenes import mostly_long

import vemcvx as vx
from vemcvx.linear import order_by_nested_dissection

pytestmark = pytest.mark.arithmetic
EACH = [vx.SuperLU(), pytest.param(vx.Pardiso(), marks=needs("pymklpardiso"))]
TOUCHED = {"some": [3, 20, 7, 15], "none": [], "all": list(range(24)), "one body's": [2, 5]}


@mostly_long("linear", EACH, ids=str)
@pytest.mark.parametrize("touched", TOUCHED)
@mostly_long("shapes", [1, 3, 9], 0, 2)
def test_states_energies_and_work_are_those_of_dense_algebra(touched, shapes, linear):
    """Two bodies, loads of one shape, of three, and of more than are remembered; friction that holds, or slips."""
    rng = np.random.default_rng(0)
    A = np.where(rng.random((24, 24)) < 0.15, rng.random((24, 24)), 0.0)
    K = A @ A.T + np.eye(24)
    K[:10, 10:] = K[10:, :10] = 0.0
    forms, rows = rng.normal(size=(shapes, 24)), np.eye(24)[TOUCHED[touched]]
    times = np.linspace(0.0, 1.0, 11)
    parts = np.sin(np.outer(times, 1 + np.arange(shapes)))
    norms = vx.Norms(rows, 0.3) if len(rows) else None
    system = vx.System(K, lambda t: parts[np.searchsorted(times, t)] @ forms, norms)
    runs = [vx.march(system, times, condense=condense, linear=linear) for condense in (True, False)]
    for run in runs:
        assert run.certificate.max() <= 1e-12
        # K y = f - B'lam, whatever slips.
        forces = parts @ forms
        held = run.multipliers[:, :, 0] @ rows if len(rows) else 0.0
        assert np.abs(run.state @ K + held - forces).max() <= 1e-12 * np.abs(forces).max()
        assert run.energy == pytest.approx(0.5 * np.einsum("ni,ij,nj->n", run.state, K, run.state), rel=1e-12)
        moved = np.diff(run.state, axis=0)
        # The work of the load at the end of each step.
        assert np.diff(run.work) == pytest.approx(np.einsum("ni,ni->n", forces[1:], moved), rel=1e-11, abs=1e-12)
    one, two = runs
    assert np.abs(one.state - two.state).max() <= 1e-12 * np.abs(two.state).max()


def test_loads_that_differ_by_rounding_where_the_body_is_soft_are_two():
    """A stiff chain and one softer by 1e16, whose load is 1e-15 of the stiff one's and grows otherwise."""
    chain = 2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1)
    K, B = np.zeros((8, 8)), np.zeros((1, 8))
    K[:4, :4], K[4:, 4:], B[0, 7] = 1e16 * chain, chain, 1.0
    hard, soft = np.array([1.0, 0.5, 0.2, 0.1, 0, 0, 0, 0]), np.array([0, 0, 0, 0, 0, 1e-15, 0, 0])
    system = vx.System(K, lambda t: t * hard + t**2 * soft, norms=vx.Norms(B, np.array([1e-16])))
    condensed, whole = (vx.march(system, np.linspace(0.0, 1.0, 5), condense=one) for one in (True, False))
    assert max(condensed.certificate.max(), whole.certificate.max()) < 1e-12
    apart = condensed.state - whole.state
    assert np.sqrt(np.einsum("ti,ij,tj->t", apart, K, apart)).max() <= 1e-12 * condensed.norm.max()


def test_nested_dissection_is_a_permutation_with_less_fill_than_the_natural_order():
    n = 24
    points = np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2).astype(float)
    line = sp.diags_array([1.0, 1.0, 1.0], offsets=[-1, 0, 1], shape=(n, n))
    graph = sp.csr_matrix(sp.kron(line, line))
    order = order_by_nested_dissection(graph, points)
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
    # Points that coincide, or are on one side.
    for points in (*(np.zeros((n, 2)) for n in (0, 1, 9, 200)), np.repeat([[0.0, 0.0], [1.0, 0.0]], [150, 50], axis=0)):
        n, chain = len(points), sp.diags_array([1.0] * 3, offsets=[-1, 0, 1], shape=(200, 200))
        graph = sp.csr_matrix(chain if points.any() else np.ones((n, n)))
        assert np.array_equal(np.sort(order_by_nested_dissection(graph, points)), np.arange(n))
