"""The linear solvers behind the seam: each must solve and restrict; direct ones eliminate."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np
import pytest
import scipy.sparse as sp
from blocks_in_space import block, on_floor
from installed import needs
from scenes import cyclic, paper_scene, small

import vemcvx as vx
from vemcvx.linear import Iterative, Pardiso, SuperLU, choose_linear
from vemcvx.program.condensation import Condensation
from vemcvx.program.dense_factors import DenseCholesky
from vemcvx.results.files import peak_memory_mb
from vemcvx.scene import pose_scene
from vemcvx.testing import linear_suite
from vemcvx.testing.linear import solves

DIRECT = [SuperLU(), pytest.param(Pardiso(), marks=needs("pymklpardiso"))]
TIMES = np.linspace(0.0, 1.0, 7)


test_superlu = linear_suite(SuperLU())
test_pardiso = needs("pymklpardiso")(linear_suite(Pardiso()))
test_iterative = needs("pyamg")(linear_suite(Iterative()))
test_petsc = needs("petsc4py")(linear_suite(vx.PETSc()))


class Dense(vx.LinearSolver):
    """LAPACK's Cholesky factors, which programs of steps use."""

    def factorise(self, K, near_kernel=None):
        return DenseCholesky(K.toarray())


@pytest.mark.parametrize("sentence", [solves])
def test_dense(sentence):
    sentence(Dense())


OF_ONE_BLOCK = """
import numpy as np, scipy.sparse as sp
from vemcvx.linear import Pardiso
K = np.ones(({n}, {n})) + {n} * np.eye({n})
K[{size}:-1, -1] = K[-1, {size}:-1] = 0
factor, S = Pardiso().eliminate(sp.csr_matrix(K), np.arange({n}), np.array([0, {n} - 1]))
inner = np.arange(1, {n} - 1)
c = [0, {n} - 1]
wanted = K[np.ix_(c, c)] - K[np.ix_(c, inner)] @ np.linalg.solve(K[np.ix_(inner, inner)], K[np.ix_(inner, c)])
assert np.abs(S - wanted).max() < 1e-12 * {n}
assert np.abs(K @ factor.solve(np.ones({n})) - 1).max() < 1e-12
"""


@pytest.mark.long
@pytest.mark.parametrize("size", [2, 100, 256, 257, 300])
@needs("pymklpardiso")
def test_cells_of_many_vertices_make_no_block_that_pardiso_cannot_take(size):
    # A block of 257 unknowns whose rows are equal, beside others, ends the process: hence one of its own.
    code = OF_ONE_BLOCK.format(n=2 * size + 1, size=size)
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


OF_MANY_FACTORS = """
import numpy as np, vemcvx as vx
from vemcvx.linear import minimum_degree
from vemcvx.results.files import peak_memory_mb
from vemcvx.vem import Space, stiffness
mesh = vx.meshes.squares(48)
K = stiffness(Space(mesh), np.ones(mesh.n_cells), np.ones(mesh.n_cells))[98:, 98:].tocsr()
n, order, peaks, held = K.shape[0], minimum_degree(K), [], []
for _ in range(12):
    factor, S = vx.{linear}.eliminate(K, order, np.arange(96))
    factor.solve(np.ones(n))
    held = [*held, factor][-{held}:]
    peaks.append(peak_memory_mb())
print(peaks[3], peaks[-1])
"""


@pytest.mark.long
@pytest.mark.skipif(peak_memory_mb() is None, reason="Windows does not tell the most memory that a process has held")
@pytest.mark.parametrize("linear", DIRECT, ids=str)
def test_factors_that_nobody_holds_give_their_memory_back(linear):
    """By how much the peak of a process grows from the 4th to the 12th factor, if one is held and if all are."""

    def growth(held):
        code = OF_MANY_FACTORS.format(linear=linear, held=held)
        # Of what is returned to it, the C library keeps more or less for itself unless it is told not to.
        told = {**os.environ, "MALLOC_MMAP_THRESHOLD_": "65536"}
        run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=told)
        early, late = map(float, run.stdout.split())
        return late - early

    assert growth(held=1) < growth(held=12) / 4


@pytest.mark.long
def test_iterative_solves_contact_matrix_free():
    pytest.importorskip("pyamg")
    scene, mesh = paper_scene(cyclic), small("squares", 16)
    # No two instants in turn have the same load: where nothing moves, what is at its bound neither sticks nor slips.
    times = np.linspace(0.0, 1.0, 8)
    direct = vx.simulate(scene, mesh, times, solver=vx.Newton())
    iterative = vx.simulate(scene, mesh, times, solver=vx.Newton(), linear=vx.Iterative())
    assert iterative.certificate.max() < 1e-8
    assert np.array_equal(iterative.contact.sticking, direct.contact.sticking)
    assert np.abs(iterative.displacement - direct.displacement).max() < 1e-8 * np.abs(direct.displacement).max()


@pytest.mark.long
def test_iterative_serves_scenes_without_friction():
    pytest.importorskip("pyamg")
    scene = vx.Scene(*(e for e in paper_scene() if not isinstance(e, vx.TrescaFriction)))
    mesh = small("voronoi", 12)
    direct = vx.simulate(scene, mesh, TIMES, store="last")
    iterative = vx.simulate(scene, mesh, TIMES, store="last", linear=vx.Iterative())
    assert iterative.solver.startswith("Direct")
    assert np.abs(iterative.displacement - direct.displacement).max() < 1e-9 * np.abs(direct.displacement).max()


@pytest.mark.long
def test_iterative_says_when_it_does_not_converge():
    pytest.importorskip("pyamg")
    scene = vx.Scene(vx.Elasticity(1.0, 0.4999999), *(e for e in paper_scene() if not isinstance(e, vx.Elasticity)))
    with pytest.raises(vx.SceneError, match=r"^Iterative: the cycle serves .* too badly .*poisson < 0\.49.*SuperLU"):
        vx.simulate(scene, small("squares", 24), TIMES, linear=vx.Iterative())
    with pytest.raises(vx.SceneError, match=r"^Iterative: 2 iterations left a residual of .*poisson < 0\.49.*SuperLU"):
        vx.simulate(paper_scene(), small("squares", 24), TIMES, linear=vx.Iterative(max_iterations=2))


@pytest.mark.parametrize("tolerance", [0.5, 1e-2, 1e-4, 1e-12])
def test_energies_of_inexact_solves_are_bounds(tolerance):
    """From above, and not by more than the roughness of the solve and the bound on the spectrum account for."""
    pytest.importorskip("pyamg")
    system = pose_scene(paper_scene(), small("voronoi", 14)).system
    exact, inexact = SuperLU().factorise(system.K), Iterative(tolerance).factorise(system.K, system.near_kernel)
    smooth = system.force(1.0)
    rough = np.random.default_rng(4).normal(size=system.n)
    one = np.eye(1, system.n, 7)[0]
    for b in (smooth, rough, one, system.K @ rough, smooth - system.K @ inexact.solve(smooth)):
        energy = exact.energy(b)
        assert energy <= inexact.energy(b) * (1 + 1e-9)
        assert inexact.energy(b) < 1.5 * energy
        assert exact.energy(b) == pytest.approx(float(b @ exact.solve(b)), rel=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("friction", [True, False], ids=["friction", "no friction"])
@pytest.mark.parametrize("tolerance", [0.1, 1e-2, 1e-4, 1e-8])
def test_certificates_hold_whatever_the_tolerance(tolerance, friction):
    """Of one step: 1/2 |u - u*|^2 <= gap, the loads being those of the scene and not what a solve made of them."""
    pytest.importorskip("pyamg")
    parts = (e for e in paper_scene() if friction or not isinstance(e, vx.TrescaFriction))
    scene, mesh = vx.Scene(*parts), small("voronoi", 12)
    exact = vx.simulate(scene, mesh, [0.0, 1.0])
    history = vx.simulate(scene, mesh, [0.0, 1.0], linear=vx.Iterative(tolerance), check=False)
    apart = vx.measures.energy_distance(history, exact, kind="nodal").absolute
    bound = history.certificate[-1] * np.sqrt(2 * history.energy[-1])
    assert apart <= bound * (1 + 1e-6) + 1e-10 * np.sqrt(2 * exact.energy[-1])
    assert bound < 10 * tolerance * np.sqrt(2 * exact.energy[-1])


@pytest.mark.parametrize(
    ("setting", "found"),
    [({"tolerance": wrong}, str(wrong)) for wrong in (0, 1, 10, np.inf, np.nan, -1e-3, None, "1e-3", True)]
    + [({"max_iterations": wrong}, str(wrong)) for wrong in (0, -1, 2.5, np.nan, None, "9", True)],
)
def test_settings_of_iterative_that_mean_nothing_are_refused(setting, found):
    name = next(iter(setting))
    with pytest.raises(vx.SceneError, match=rf"^Iterative: found {name} = .*{found}"):
        vx.Iterative(**setting)


def test_the_choice_is_by_size_and_can_be_overridden(caplog):
    direct = Pardiso() if Pardiso.installed() else SuperLU()
    assert choose_linear(1_000_000) == direct
    assert choose_linear(100) == SuperLU()
    assert choose_linear(10, Iterative(tolerance=1e-8)) == Iterative(tolerance=1e-8)
    with caplog.at_level("INFO", logger="vemcvx"):
        chosen = choose_linear(3_000_000)
    assert "3000000 unknowns" in caplog.text
    assert chosen == (Iterative() if find_spec("pyamg") else direct)


@pytest.mark.parametrize(("installed", "gigabytes"), [(True, (0.2, 3.6)), (False, (0.66, 19.0))])
def test_in_space_the_choice_is_by_the_memory_that_is_foreseen(monkeypatch, caplog, installed, gigabytes):
    """And said beforehand: of cubes with 26,040 unknowns as measured, and of 260,000."""
    monkeypatch.setattr(Pardiso, "installed", staticmethod(lambda: installed))
    direct = Pardiso() if installed else SuperLU()
    for takes, n in zip(gigabytes, (26_040, 260_000), strict=True):
        assert direct.memory_in_space(n) == pytest.approx(takes * 1e9, rel=0.4)
    with caplog.at_level("INFO", logger="vemcvx"):
        assert choose_linear(26_040, modes=6, retained=840) == direct
    assert re.search(rf"{type(direct).__name__}; factors for 26040 unknowns in space take 0\.\d+ GB", caplog.text)
    able = Iterative() if find_spec("pyamg") else direct
    assert choose_linear(2_000_000, modes=6) == able
    assert choose_linear(260_000, modes=6) == (direct if installed else able)
    assert choose_linear(66_825, modes=6, retained=6_075) == direct  # 2,025 contacts
    assert choose_linear(30_000, modes=6, retained=10_000) == able
    # In the plane factors are sparser.
    assert choose_linear(2_000_000, modes=3) == direct


def test_systems_with_six_rigid_motions_are_in_space(monkeypatch):
    pytest.importorskip("pyamg")
    monkeypatch.setattr("vemcvx.linear.default.MOST_MEMORY", 1.0)
    system = on_floor(block(2), lambda t: np.zeros(3))
    assert system.linear() == Iterative()
    assert replace(system, near_kernel=None).linear() == SuperLU()


@pytest.mark.long
def test_a_run_chooses_once(monkeypatch, caplog):
    """Also where steps of several lengths are factorised for: what is said of the choice is said once."""
    pytest.importorskip("pyamg")
    monkeypatch.setattr("vemcvx.linear.default.LARGEST_FACTOR", 10)
    scene = vx.Scene(*paper_scene(), vx.Viscosity(0.1, 0.1))
    with caplog.at_level("INFO", logger="vemcvx"):
        vx.simulate(scene, small("squares", 6), [0.0, 0.1, 0.3])
    assert caplog.text.count("linear solver: Iterative") == 1


def test_what_is_not_installed_is_not_chosen(monkeypatch):
    monkeypatch.setattr(vx.linear.pardiso, "PACKAGE", "not_there_at_all")
    assert choose_linear(1_000_000) == SuperLU()
    with pytest.raises(vx.NotAccepted, match=r"^Pardiso: the package py-mkl-pardiso .* not installed; pip .*SuperLU"):
        vx.Pardiso().factorise(sp.eye_array(3, format="csr"))


@dataclass(frozen=True)
class Another(vx.LinearSolver):
    """None of ours, with what the base class asks for."""

    def factorise(self, K, near_kernel=None):
        return SuperLU().factorise(K)


class Eliminating(Another):
    eliminates = True

    def eliminate(self, K, order, last):
        assert np.array_equal(np.sort(order), np.arange(K.shape[0]))
        return SuperLU().eliminate(K, order, last)


def test_programs_are_condensed_by_whoever_eliminates():
    system = pose_scene(paper_scene(), small("squares", 6)).system
    ours, full, condensed = (Condensation(system, linear=linear) for linear in (None, Another(), Eliminating()))
    assert full.whole
    assert len(full.retained) == system.n
    assert not condensed.whole
    assert np.array_equal(condensed.retained, ours.retained)
    assert np.array_equal(condensed.operators.K, ours.operators.K)
    plain = Condensation(replace(system, order=None), linear=Eliminating())
    assert np.abs(plain.operators.K - ours.operators.K).max() < 1e-12 * np.abs(ours.operators.K).max()


def test_who_cannot_eliminate_says_so():
    with pytest.raises(vx.NotAccepted, match=r"^linear solver Another: it gives no Schur complements, .*SuperLU\(\)"):
        Another().eliminate(sp.eye_array(2, format="csr"), np.arange(2), np.arange(1))


def test_singular_matrices_are_a_clear_error():
    chain = np.array([[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
    with pytest.raises(vx.SceneError, match="stiffness matrix is singular.*Add supports"):
        vx.march(vx.System(chain, lambda t: np.array([t, 0.0, 0.0])), [0, 1])


@pytest.mark.long
def test_one_copy_of_the_factors_is_kept():
    """The Schur complement is read off copies that are given back; the factor goes on solving."""
    system = pose_scene(paper_scene(), small("voronoi", 12)).system
    retained = np.unique(system.norms.B.indices)
    factor, S = SuperLU().eliminate(system.K, system.elimination_order(), retained)
    assert factor._lu.L.data.nbytes + factor._lu.U.data.nbytes + factor._lu.L.indices.nbytes == 0
    inside = np.linalg.inv(system.K.toarray())[np.ix_(retained, retained)]
    assert np.abs(S @ inside - np.eye(len(retained))).max() < 1e-10
    x = np.random.default_rng(5).normal(size=system.n)
    assert np.abs(factor.solve(system.K @ x) - x).max() < 1e-9


@pytest.mark.parametrize("at_once", [1, 100])
def test_energies_of_many_rows_are_found_in_parts(monkeypatch, at_once):
    """Of unit vectors they are the diagonal of K^{-1}, however many are solved for together."""
    n = 30
    K = sp.csr_matrix(sp.diags_array([np.full(n - 1, -1.0), np.full(n, 2.5), np.full(n - 1, -1.0)], offsets=[-1, 0, 1]))
    monkeypatch.setattr("vemcvx.linear.factor.AT_ONCE", at_once)
    factor, inverse = vx.SuperLU().factorise(K), np.linalg.inv(K.toarray())
    found = factor.energies(sp.eye_array(n, format="csr"))
    # K has the condition 9; entries of its inverse are known to that many eps, and a few for sums.
    assert np.abs(found - np.diag(inverse)).max() <= 64 * np.finfo(float).eps
    some = np.array([7, 0, 29, 3])
    assert np.abs(factor.flexibility(some, n) - inverse[np.ix_(some, some)]).max() <= 64 * np.finfo(float).eps
    assert len(vx.SuperLU().factorise(K).energies(sp.csr_matrix((0, n)))) == 0


def test_energies_of_rows_with_one_entry_are_those_of_any():
    rng, n = np.random.default_rng(6), 12
    root = rng.normal(size=(n, n))
    K = root @ root.T + np.eye(n)
    rows = sp.csr_matrix(-1.5 * np.eye(n)[[3, 0, 3, 7]])
    alone, beside = (
        DenseCholesky(K).energies(some) for some in (rows, sp.vstack([rows, np.eye(n)[:1] - np.eye(n)[1:2]], "csr"))
    )
    # Both are sums of n squares of the same numbers.
    assert alone == pytest.approx(beside[:4], rel=2 * n * np.finfo(float).eps)
    assert alone[0] == alone[2]
