"""The linear solvers behind the seam: every one must solve, restrict and scale; one may eliminate."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import cyclic, paper_scene, small

import vemcvx as vx
from vemcvx.linear import DenseCholesky, Multigrid, Scaled, SuperLU, choose_linear
from vemcvx.scene.pose import pose

TIMES = np.linspace(0.0, 1.0, 7)


@pytest.fixture(params=["superlu", "multigrid", "dense"])
def factored(request):
    system = pose(paper_scene(), small("squares", 12)).system
    if request.param == "dense":
        return system.K, DenseCholesky(system.K.toarray())
    if request.param == "multigrid":
        pytest.importorskip("pyamg")
        return system.K, Multigrid().factorise(system.K, system.near_kernel)
    return system.K, SuperLU().factorise(system.K)


def test_every_factor_solves(factored):
    K, factor = factored
    x = np.random.default_rng(0).normal(size=(K.shape[0], 2))
    # Relative residuals of 1e-12 at condition numbers near 1e4.
    assert np.abs(factor.solve(K @ x[:, 0]) - x[:, 0]).max() < 1e-7
    assert np.abs(factor.solve(np.ascontiguousarray(K @ x)) - x).max() < 1e-7
    assert not factor.solve(np.zeros(K.shape[0])).any()


def test_every_factor_restricts(factored):
    K, factor = factored
    F = np.flatnonzero(np.arange(K.shape[0]) % 7 > 0)
    K_FF = K[F][:, F] if not isinstance(factor, DenseCholesky) else K.toarray()[np.ix_(F, F)]
    x = np.random.default_rng(1).normal(size=len(F))
    assert np.abs(factor.within(K_FF, F).solve(K_FF @ x) - x).max() < 1e-7


def test_a_scaled_factor_is_the_factor_of_the_scaled_matrix(factored):
    K, factor = factored
    D = 2.0 ** np.random.default_rng(2).integers(-3, 4, size=K.shape[0])
    b = np.random.default_rng(3).normal(size=K.shape[0])
    scaled = K.multiply(D[:, None]).multiply(D[None, :]).tocsr() / 4.0
    x = Scaled(factor, D, 4.0).solve(b)
    assert np.abs(scaled @ x - b).max() < 1e-6


def test_multigrid_solves_contact_matrix_free():
    pytest.importorskip("pyamg")
    scene, mesh = paper_scene(cyclic), small("squares", 16)
    direct = vx.simulate(scene, mesh, TIMES, solver=vx.Newton())
    iterative = vx.simulate(scene, mesh, TIMES, solver=vx.Newton(), linear=vx.Multigrid())
    assert iterative.certificate.max() < 1e-8
    assert np.array_equal(iterative.contact.sticking, direct.contact.sticking)
    assert np.abs(iterative.displacement - direct.displacement).max() < 1e-8 * np.abs(direct.displacement).max()


def test_multigrid_serves_scenes_without_friction():
    pytest.importorskip("pyamg")
    scene = vx.Scene(*(e for e in paper_scene() if not isinstance(e, vx.TrescaFriction)))
    mesh = small("voronoi", 12)
    direct = vx.simulate(scene, mesh, TIMES, store="last")
    iterative = vx.simulate(scene, mesh, TIMES, store="last", linear=vx.Multigrid())
    assert iterative.solver.startswith("Direct")
    assert np.abs(iterative.displacement - direct.displacement).max() < 1e-9 * np.abs(direct.displacement).max()


def test_multigrid_says_when_it_does_not_converge():
    pytest.importorskip("pyamg")
    scene = vx.Scene(vx.Elasticity(1.0, 0.4999999), *(e for e in paper_scene() if not isinstance(e, vx.Elasticity)))
    with pytest.raises(vx.SceneError, match=r"Multigrid: 200 iterations left a residual of .*poisson < 0\.49.*SuperLU"):
        vx.simulate(scene, small("squares", 24), TIMES, linear=vx.Multigrid())


def test_the_choice_is_by_size_and_can_be_overridden(caplog):
    assert choose_linear(1_000_000) == SuperLU()
    assert choose_linear(10, Multigrid(tolerance=1e-8)) == Multigrid(tolerance=1e-8)
    with caplog.at_level("INFO", logger="vemcvx"):
        chosen = choose_linear(3_000_000)
    assert "3000000 unknowns" in caplog.text
    assert isinstance(chosen, (Multigrid, SuperLU))


def test_singular_matrices_are_a_clear_error():
    chain = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    with pytest.raises(vx.SceneError, match="stiffness matrix is singular.*Add supports"):
        vx.march(vx.System(chain, lambda t: np.array([t, 0.0, 0.0])), [0, 1])


def test_one_copy_of_the_factors_is_kept():
    """The Schur complement is read off copies that are given back; the factor goes on solving."""
    system = pose(paper_scene(), small("voronoi", 12)).system
    touched = np.unique(system.norms.B.indices)
    factor, S = SuperLU().eliminate(system.K, system.order, touched)
    assert factor._lu.L.data.nbytes + factor._lu.U.data.nbytes + factor._lu.L.indices.nbytes == 0
    inside = np.linalg.inv(system.K.toarray())[np.ix_(touched, touched)]
    assert np.abs(S @ inside - np.eye(len(touched))).max() < 1e-10
    x = np.random.default_rng(5).normal(size=system.n)
    assert np.abs(factor.solve(system.K @ x) - x).max() < 1e-9
