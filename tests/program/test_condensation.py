"""Condensed runs, compared with dense linear algebra."""

import numpy as np
import pytest
import scipy.sparse as sp
from installed import needs
from scenes import mostly_long

import vemcvx as vx
from vemcvx.linear import order_by_nested_dissection

pytestmark = pytest.mark.arithmetic
LINEAR = [vx.SuperLU(), pytest.param(vx.Pardiso(), marks=needs("pymklpardiso"))]
TOUCHING = {"some": [3, 20, 7, 15], "none": [], "all": list(range(24)), "one body's": [2, 5]}


@mostly_long("linear", LINEAR, ids=str)
@pytest.mark.parametrize("touching", TOUCHING)
@mostly_long("shapes", [1, 3, 9], 0, 2)
def test_states_energies_and_work_agree_with_dense_algebra(touching, shapes, linear):
    """The loads are combinations of 1, 3 or 9 vectors. A condensed run stores at most six vectors."""
    rng = np.random.default_rng(0)
    A = np.where(rng.random((24, 24)) < 0.15, rng.random((24, 24)), 0.0)
    K = A @ A.T + np.eye(24)
    K[:10, 10:] = K[10:, :10] = 0.0
    forms, rows = rng.normal(size=(shapes, 24)), np.eye(24)[TOUCHING[touching]]
    times = np.linspace(0.0, 1.0, 11)
    factors = np.sin(np.outer(times, 1 + np.arange(shapes)))
    norms = vx.Norms(rows, 0.3) if len(rows) else None
    system = vx.System(K, lambda t: factors[np.searchsorted(times, t)] @ forms, norms)
    runs = [vx.march(system, times, condense=condense, linear=linear) for condense in (True, False)]
    loads = factors @ forms
    for run in runs:
        assert run.certificate.max() <= 1e-12
        friction = run.multipliers[:, :, 0] @ rows if len(rows) else 0.0
        assert np.abs(run.state @ K + friction - loads).max() <= 1e-12 * np.abs(loads).max()
        assert run.energy == pytest.approx(0.5 * np.einsum("ni,ij,nj->n", run.state, K, run.state), rel=1e-12)
        # The work of a step is the work of the load at the end of the step.
        work = np.einsum("ni,ni->n", loads[1:], np.diff(run.state, axis=0))
        assert np.diff(run.work) == pytest.approx(work, rel=1e-11, abs=1e-12)
    condensed, full = runs
    assert np.abs(condensed.state - full.state).max() <= 1e-12 * np.abs(full.state).max()


def test_small_loads_on_soft_bodies_are_not_taken_for_rounding():
    """The load is about t on a chain of stiffness 1e16, and 1e-15 t^2 on a chain of stiffness 1."""
    chain = 2 * np.eye(4) - np.eye(4, k=1) - np.eye(4, k=-1)
    K, B = np.zeros((8, 8)), np.zeros((1, 8))
    K[:4, :4], K[4:, 4:], B[0, 7] = 1e16 * chain, chain, 1.0
    hard, soft = np.array([1.0, 0.5, 0.2, 0.1, 0, 0, 0, 0]), np.array([0, 0, 0, 0, 0, 1e-15, 0, 0])
    system = vx.System(K, lambda t: t * hard + t**2 * soft, norms=vx.Norms(B, np.array([1e-16])))
    condensed, full = (vx.march(system, np.linspace(0.0, 1.0, 5), condense=one) for one in (True, False))
    assert max(condensed.certificate.max(), full.certificate.max()) < 1e-12
    apart = condensed.state - full.state
    assert np.sqrt(np.einsum("ti,ij,tj->t", apart, K, apart)).max() <= 1e-12 * condensed.norm.max()


def test_nested_dissection_permutes_and_reduces_fill():
    n = 24
    points = np.stack(np.meshgrid(np.arange(n), np.arange(n)), axis=-1).reshape(-1, 2).astype(float)
    line = sp.diags_array([1.0, 1.0, 1.0], offsets=[-1, 0, 1], shape=(n, n))
    graph = sp.csr_matrix(sp.kron(line, line))
    order = order_by_nested_dissection(graph, points)
    assert np.array_equal(np.sort(order), np.arange(n * n))
    K = sp.csc_matrix(graph * -1.0 + sp.eye_array(n * n) * 20)
    natural, dissected = (
        sp.linalg.splu(K[p][:, p], permc_spec="NATURAL", diag_pivot_thresh=0.0).nnz for p in (np.arange(n * n), order)
    )
    assert dissected < 0.8 * natural
    # All points coincide.
    order = order_by_nested_dissection(sp.csr_matrix(np.ones((200, 200))), np.zeros((200, 2)))
    assert np.array_equal(np.sort(order), np.arange(200))
