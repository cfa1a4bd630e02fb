"""The linear solvers behind the seam: every one must solve, restrict and scale; one may eliminate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import cyclic, paper_scene, small

import vemcvx as vx
from vemcvx.linear import DenseCholesky, Multigrid, Scaled, SuperLU, choose_linear
from vemcvx.program.condensation import Condensation
from vemcvx.program.kernel import Kernel
from vemcvx.scene.pose import pose_scene

TIMES = np.linspace(0.0, 1.0, 7)


@pytest.fixture(params=["superlu", "multigrid", "dense"])
def factored(request):
    system = pose_scene(paper_scene(), small("squares", 12)).system
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


@pytest.mark.parametrize("where", ["everywhere", "in one place"])
def test_every_factor_knows_the_energy_of_random_forces(factored, where):
    """sum size_i^2 (K^-1)_ii, from eight samples.

    Of sum_k l_k z_k^2 with z_k normal the mean of eight spreads most where one l_k counts alone, and is then less than
    .107 of its mean, or more than 3.27 times, once in a thousand draws (chi squared with 8 degrees of freedom).
    """
    K, factor = factored
    size = np.random.default_rng(4).uniform(1, 2, K.shape[0])
    if where == "in one place":
        size[np.arange(len(size)) != 17] = 0.0
    exact = size**2 @ np.diag(np.linalg.inv(K.toarray()))
    assert 0.107 * exact < factor.random_energy(size) < 3.27 * exact


def test_energies_of_random_forces_are_the_same_numbers_in_all_units():
    K = pose_scene(paper_scene(), small("squares", 6)).system.K
    size = np.random.default_rng(5).uniform(1, 2, K.shape[0])
    one, two = (SuperLU().factorise(unit * K).random_energy(size) for unit in (1.0, 0.125))
    assert two == 8 * one


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
    with pytest.raises(vx.SceneError, match=r"^Multigrid: the cycle serves .* too badly .*poisson < 0\.49.*SuperLU"):
        vx.simulate(scene, small("squares", 24), TIMES, linear=vx.Multigrid())
    with pytest.raises(vx.SceneError, match=r"^Multigrid: 2 iterations left a residual of .*poisson < 0\.49.*SuperLU"):
        vx.simulate(paper_scene(), small("squares", 24), TIMES, linear=vx.Multigrid(max_iterations=2))


@pytest.mark.parametrize("tolerance", [0.5, 1e-2, 1e-4, 1e-12])
def test_energies_of_inexact_solves_are_bounds(tolerance):
    """From above, and not by more than the roughness of the solve and the bound on the spectrum account for."""
    pytest.importorskip("pyamg")
    system = pose_scene(paper_scene(), small("voronoi", 14)).system
    exact, inexact = SuperLU().factorise(system.K), Multigrid(tolerance).factorise(system.K, system.near_kernel)
    smooth = system.force(1.0)
    rough = np.random.default_rng(4).normal(size=system.n)
    one = np.eye(1, system.n, 7)[0]
    D = 2.0 ** np.random.default_rng(2).integers(-3, 4, size=system.n)
    for b in (smooth, rough, one, system.K @ rough, smooth - system.K @ inexact.solve(smooth)):
        energy = exact.energy(b)
        assert energy <= inexact.energy(b) * (1 + 1e-9)
        assert inexact.energy(b) < 1.5 * energy
        assert exact.energy(b) == pytest.approx(float(b @ exact.solve(b)), rel=1e-12)
        assert Scaled(inexact, D, 4.0).energy(b * D) == pytest.approx(4.0 * inexact.energy(b), rel=1e-12)
    F = np.flatnonzero(np.arange(system.n) % 3 > 0)
    K_FF = system.K[F][:, F]
    held = SuperLU().factorise(K_FF).energy(smooth[F])
    assert held <= inexact.within(K_FF, F).energy(smooth[F]) < 1.5 * held


@pytest.mark.parametrize("friction", [True, False], ids=["friction", "no friction"])
@pytest.mark.parametrize("tolerance", [0.1, 1e-2, 1e-4, 1e-8])
def test_certificates_hold_whatever_the_tolerance(tolerance, friction):
    """Of one step: 1/2 |u - u*|^2 <= gap, the loads being those of the scene and not what a solve made of them."""
    pytest.importorskip("pyamg")
    parts = (e for e in paper_scene() if friction or not isinstance(e, vx.TrescaFriction))
    scene, mesh = vx.Scene(*parts), small("voronoi", 12)
    exact = vx.simulate(scene, mesh, [0.0, 1.0])
    history = vx.simulate(scene, mesh, [0.0, 1.0], linear=vx.Multigrid(tolerance), check=False)
    apart = vx.measures.energy_distance(history, exact, kind="nodal").absolute
    bound = history.certificate[-1] * np.sqrt(2 * history.energy[-1])
    assert apart <= bound * (1 + 1e-6) + 1e-10 * np.sqrt(2 * exact.energy[-1])
    assert bound < 10 * tolerance * np.sqrt(2 * exact.energy[-1])


@pytest.mark.parametrize(
    ("setting", "found"),
    [({"tolerance": wrong}, str(wrong)) for wrong in (0, 1, 10, np.inf, np.nan, -1e-3, None, "1e-3", True)]
    + [({"max_iterations": wrong}, str(wrong)) for wrong in (0, -1, 2.5, np.nan, None, "9", True)],
)
def test_settings_of_multigrid_that_mean_nothing_are_refused(setting, found):
    name = next(iter(setting))
    with pytest.raises(vx.SceneError, match=rf"^Multigrid: found {name} = .*{found}"):
        vx.Multigrid(**setting)


def test_the_choice_is_by_size_and_can_be_overridden(caplog):
    assert choose_linear(1_000_000) == SuperLU()
    assert choose_linear(10, Multigrid(tolerance=1e-8)) == Multigrid(tolerance=1e-8)
    with caplog.at_level("INFO", logger="vemcvx"):
        chosen = choose_linear(3_000_000)
    assert "3000000 unknowns" in caplog.text
    assert isinstance(chosen, (Multigrid, SuperLU))


@dataclass(frozen=True)
class Another(vx.LinearSolver):
    """None of ours, with what the base class asks for."""

    def factorise(self, K, near_kernel=None):
        return SuperLU().factorise(K)


class Eliminating(Another):
    eliminates = True

    def eliminate(self, K, order, last):
        return SuperLU().eliminate(K, order, last)


def test_programs_are_condensed_by_whoever_eliminates():
    system = pose_scene(paper_scene(), small("squares", 6)).system
    ours, full, condensed = (Condensation(system, linear=linear) for linear in (None, Another(), Eliminating()))
    assert full.whole
    assert len(full.retained) == system.n
    assert not condensed.whole
    assert np.array_equal(condensed.retained, ours.retained)
    assert np.array_equal(condensed.operators.K, ours.operators.K)


def test_who_cannot_eliminate_says_so():
    with pytest.raises(vx.NotAccepted, match=r"^linear solver Another: it gives no Schur complements, .*SuperLU\(\)"):
        Another().eliminate(sp.eye_array(2, format="csr"), np.arange(2), np.arange(1))


def test_singular_matrices_are_a_clear_error():
    chain = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    with pytest.raises(vx.SceneError, match="stiffness matrix is singular.*Add supports"):
        vx.march(vx.System(chain, lambda t: np.array([t, 0.0, 0.0])), [0, 1])


INDEFINITE = {
    "indefinite": [[1.0, 2.0], [2.0, 1.0]],
    "singular but for rounding": [[1.0, 1.0], [1.0, 1.0 + 2.0**-52]],
    "a stiff part and a soft one": [[1e12, 1e6, 0.0], [1e6, 1.0 - 1e-9, 0.0], [0.0, 0.0, 1.0]],
}


@pytest.mark.parametrize("K", INDEFINITE.values(), ids=INDEFINITE)
@pytest.mark.parametrize("terms", [0, 1], ids=["no terms", "friction"])
@pytest.mark.parametrize("way", [{}, {"condense": False}, {"linear": vx.Multigrid()}], ids=str)
def test_indefinite_matrices_are_refused(K, terms, way):
    """All diagonals are positive; the pivots are not."""
    if "linear" in way:
        pytest.importorskip("pyamg")
    norms = vx.Norms(np.eye(1, len(K)), 0.1) if terms else None
    system = vx.System(K, lambda t: t * np.ones(len(K)), norms=norms)
    with pytest.raises(vx.SceneError, match="singular or indefinite.*the K of a System must be positive definite"):
        vx.march(system, [0, 1], **way)


def test_indefinite_matrices_with_a_kernel_are_refused():
    """Semidefinite but for a motion that gains a little energy: the anchors of the kernel do not hide it."""
    chain = np.diag([1.0, 2.0, 2.0, 1.0]) - np.eye(4, k=1) - np.eye(4, k=-1)
    stiffness, motions = np.linalg.eigh(chain)
    shared = {
        "load": lambda t: t * np.array([1.0, 0.0, 0.0, -1.0]),
        "norms": vx.Norms(np.eye(4), 1.0),
        "kernel": Kernel(np.ones((4, 1)), ("translation",)),
    }
    assert vx.march(vx.System(chain, **shared), [0, 1]).certificate.max() < 1e-8
    for gain in (1e-2, 1e-6):
        K = chain - (stiffness[1] + gain) * np.outer(motions[:, 1], motions[:, 1])
        with pytest.raises(vx.SceneError, match="singular or indefinite"):
            vx.march(vx.System(K, **shared), [0, 1])


def test_one_copy_of_the_factors_is_kept():
    """The Schur complement is read off copies that are given back; the factor goes on solving."""
    system = pose_scene(paper_scene(), small("voronoi", 12)).system
    retained = np.unique(system.norms.B.indices)
    factor, S = SuperLU().eliminate(system.K, system.order, retained)
    assert factor._lu.L.data.nbytes + factor._lu.U.data.nbytes + factor._lu.L.indices.nbytes == 0
    inside = np.linalg.inv(system.K.toarray())[np.ix_(retained, retained)]
    assert np.abs(S @ inside - np.eye(len(retained))).max() < 1e-10
    x = np.random.default_rng(5).normal(size=system.n)
    assert np.abs(factor.solve(system.K @ x) - x).max() < 1e-9
