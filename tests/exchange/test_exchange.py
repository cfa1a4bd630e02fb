"""Step programs are written and read bit for bit, and other software solves them."""

from __future__ import annotations

import json
import re
from functools import cache

import clarabel
import highspy
import numpy as np
import pytest
import scipy.sparse as sp
from reading_cbf import read_cbf, to_second_order
from scenes import mostly_long

import vemcvx as vx
from vemcvx.program import Operators, StepProgram

EPS = float(np.finfo(float).eps)
TIMES = np.linspace(0.0, 1.0, 4)
FORMATS = "npz", "mtx", "cbf", "mps"
STEEL = vx.Elasticity(young=200.0, poisson=0.3)
FRICTION = vx.TrescaFriction(bound=4.0, on="bottom")


def press(x, t):
    return np.column_stack([np.full(len(x), 3 * t), np.full(len(x), -6.0 * t)])


def push(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


SCENES = {
    "friction": (STEEL, vx.Clamp(on="right"), vx.Traction(push, on="left"), vx.BilateralContact(on="bottom"), FRICTION),
    "bounds": (
        STEEL,
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.05 * t, -0.01 * t], (len(x), 1)), on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(bound=2.0, on="bottom", while_closed=False),
    ),
    "soft": (
        STEEL,
        vx.Clamp(on="left"),
        vx.Traction(press, on="top"),
        vx.NormalCompliance(500.0, on="bottom"),
        vx.TrescaFriction(bound=1.0, on="bottom"),
    ),
    "free": (
        STEEL,
        vx.Traction(lambda x, t: np.column_stack([t + 0 * x[:, 0], 0 * x[:, 0]]), on="left"),
        vx.BilateralContact(on="bottom"),
        FRICTION,
    ),
}
pytestmark = pytest.mark.filterwarnings("ignore:supports. nothing but friction")
condensed = mostly_long("condense", [True, False])


@cache
def solve(name, condense=True):
    """Return the solved program of a step, or an unsolved program for "in space"."""
    if name != "in space":
        return list(vx.programs(vx.Scene(*SCENES[name]), vx.meshes.squares(3), TIMES, condense=condense))[1]
    rng = np.random.default_rng(0)
    A = rng.normal(size=(9, 9))
    B, D = (sp.csr_matrix(rng.normal(size=(rows, 9))) for rows in (6, 2))
    operators = Operators(A @ A.T + np.eye(9), B, block=2, D=D, compliance=np.array([0.0, 0.3]))
    return StepProgram(operators, 3 * rng.normal(size=9), np.full(3, 0.7), 0.1 * rng.normal(size=6), np.full(2, 0.05))


@condensed
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("form", FORMATS)
def test_programs_are_read_back_bit_for_bit(tmp_path, form, name, condense):
    """A CBF file holds a factor F of K. The product F'F has rounding errors."""
    condense = condense or (form, name) == ("cbf", "free")  # CBF needs the condensed program
    program, path = solve(name, condense), tmp_path / f"step.{form}"
    assert vx.write_program(program, path) == path
    back = vx.read_program(path)
    ours, theirs = program.operators, back.operators
    for one, two in ((program.g, back.g), (program.w, back.w), (program.b, back.b), (program.e, back.e)):
        assert np.array_equal(one, two)
    assert np.array_equal(ours.compliance, theirs.compliance)
    assert (ours.block, ours.features) == (theirs.block, theirs.features)
    assert (ours.B != theirs.B).nnz == (ours.D != theirs.D).nnz == 0
    off = abs(ours.K - theirs.K).max()
    assert off <= (4 * len(program.g) * EPS * abs(ours.K).max() if form == "cbf" else 0.0)
    answer = program.answer
    found = back.certify(answer.d, answer.lam, answer.p)
    assert found.gap <= 4 * (program.certificate.gap + program.certificate.floor) + found.floor
    if form == "npz":
        assert isinstance(back, vx.SolvedProgram)
        # Programs with a kernel have other rounding errors after reading.
        floor = program.certificate.floor
        assert back.bounds == (
            program.bounds if ours.kernel is None else pytest.approx(program.bounds, rel=0, abs=floor)
        )
    if name == "free":
        N = theirs.kernel
        assert ours.kernel.shape == N.shape == (len(program.g), 1)
        assert abs(N.T @ N - 1).max() < 1e-14
        assert abs(abs(float(ours.kernel[:, 0] @ N[:, 0])) - 1) < 1e-10
        assert np.abs(ours.K @ N).max() < 1e-12 * np.abs(ours.K).max()


def test_the_description_beside_a_file_has_origin_size_and_optimum(tmp_path):
    program = solve("friction")
    vx.write_program(program, tmp_path / "a.npz")
    words = json.loads((tmp_path / "a.json").read_text())
    assert (words["step"], words["t"], words["format"]) == (2, TIMES[2], "vemcvx program 1")
    assert words["origin"]["mesh"]["cells"] == 9
    assert any("Elasticity" in line for line in words["origin"]["scene"])
    optimum = words["optimum"]
    assert program.bounds == (optimum["low"], optimum["high"])
    assert optimum["low"] <= optimum["value"] <= optimum["high"]
    assert (words["unknowns"], words["nonzeros"]["B"]) == (len(program.g), program.operators.B.nnz)
    # Equal programs give equal files.
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    vx.write_program(program, tmp_path / "a.npz")
    assert first == {path.name: path.read_bytes() for path in tmp_path.iterdir()}


@condensed
@pytest.mark.parametrize("name", ["friction", "bounds", "soft"])
def test_highs_reads_and_solves_mps_files(tmp_path, name, condense):
    """The program from the file certifies the solution of HiGHS."""
    program = solve(name, condense)
    vx.write_program(program, tmp_path / "step.mps")
    highs = highspy.Highs()
    highs.setOptionValue("output_flag", False)  # silent() prints a banner
    read, K = highs.readModel(str(tmp_path / "step.mps")), program.operators.K
    # Since version 1.16, HiGHS drops entries of K below 1e-9 with a warning.
    tiny = (K != 0).sum() > (abs(K) > 1e-9).sum()
    assert read == highspy.HighsStatus.kOk or (tiny and read == highspy.HighsStatus.kWarning)
    assert highs.getNumCol() == len(program.g) + len(program.w) + int((program.operators.compliance > 0).sum())
    highs.run()
    assert highs.modelStatusToString(highs.getModelStatus()) == "Optimal"
    back, m, n = vx.read_program(tmp_path / "step.mps"), len(program.w), len(program.g)
    x, duals = np.array(highs.getSolution().col_value), -np.array(highs.getSolution().row_dual)
    d = back.feasible(x[:n])
    found = back.certify(d, duals[:m] - duals[m : 2 * m], duals[2 * m :])
    away = d - program.answer.d
    bound = found.error + found.error_floor + program.certificate.error + program.certificate.error_floor
    assert np.sqrt(away @ K @ away) <= bound
    low, high = program.bounds
    # HiGHS has tolerances of 1e-7.
    assert low - 1e-6 <= highs.getInfo().objective_function_value <= high + 1e-6
    assert found.gap < 1e-6


@condensed
@pytest.mark.parametrize("name", ["friction", "bounds", "soft", "free", "in space"])
def test_clarabel_solves_cbf_files_through_an_independent_reader(tmp_path, name, condense):
    program = solve(name, condense or name == "free")
    vx.write_program(program, tmp_path / "step.cbf")
    cost, A, b, cones = to_second_order(*read_cbf((tmp_path / "step.cbf").read_text()))
    kinds = {"Q": clarabel.SecondOrderConeT, "L+": clarabel.NonnegativeConeT}
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # Clarabel constrains b - A x to cones. CBF constrains A x + b to cones.
    zero, kinds = sp.csc_matrix((len(cost),) * 2), [kinds[kind](size) for kind, size in cones]
    found = clarabel.DefaultSolver(zero, cost, sp.csc_matrix(-A), b, kinds, settings).solve()
    assert str(found.status) == "Solved"
    back, n, block = vx.read_program(tmp_path / "step.cbf"), len(program.g), program.operators.block
    d, z, start = np.array(found.x)[:n], np.array(found.z), cones[0][1]
    terms = z[start : start + len(program.w) * (1 + block)].reshape(-1, 1 + block)
    certificate = back.certify(back.feasible(d), -terms[:, 1:], z[start + terms.size :])
    # The tolerances of Clarabel are 1e-8.
    assert certificate.gap < 1e-6
    assert terms[:, 0] == pytest.approx(program.w, abs=1e-6)
    low, high = program.bounds if name != "in space" else [program.objective(back.feasible(d))] * 2
    assert low - 1e-6 <= found.obj_val <= high + 1e-6


def test_programs_and_formats_that_cannot_be_written_are_refused(tmp_path):
    nothing = next(vx.programs(vx.Scene(*SCENES["friction"][:3]), vx.meshes.squares(2), TIMES))
    (tmp_path / "file").touch()
    for name, what, words in (
        ("b.qps", solve("in space"), "MPS has no second-order cones"),
        ("f.cbf", solve("free", condense=False), "take the condensed program"),
        ("d.npz", nothing, "no unknowns left"),
        ("file/e.npz", solve("friction"), "cannot be written"),
    ):
        with pytest.raises(vx.ProgramError, match=words):
            vx.write_program(what, tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("name", ["b.mtx", "d.qps", "e.hdf5"])
def test_files_of_other_programs_are_refused(tmp_path, name):
    (tmp_path / name).write_text("%%MatrixMarket matrix array real general\n1 1\n1\n")
    with pytest.raises(vx.ProgramError, match=re.escape(name)):
        vx.read_program(tmp_path / name)


def coulomb(law=None, dim=2, condense=True):
    """Return the last step of a block with Coulomb's law."""

    def plate(x, t):
        y = x[:, 1] - 0.5
        return np.column_stack([0.02 * t - 0.03 * t * y, 0.03 * t * (x[:, 0] - 0.2), np.full(len(x), -0.01)])

    law = law or vx.CoulombFriction(0.3, on="bottom")
    if dim == 2:
        gap, mesh, start = 1e-3, vx.meshes.squares(4), None
        moved = vx.Clamp(on="top"), vx.Traction(press, on="left")
    else:
        gap, mesh, start = lambda x, t: 0.02 * x[:, 0] ** 2, vx.meshes.cubes(3), "settled"
        moved = (vx.PrescribedDisplacement(plate, on="top"),)
    scene = vx.Scene(STEEL, *moved, vx.UnilateralContact(gap=gap, on="bottom"), law)
    return list(vx.programs(scene, mesh, TIMES, initial=start, condense=condense))[-1]


def read_sparse(A):
    return sp.csr_matrix((A["x"][()], A["i"][()], A["p"][()]), shape=(int(A["m"][0]), int(A["n"][0])))


@mostly_long("dim, condense", [(2, True), (3, True), (2, False)], 0, 2)
def test_fclib_files_state_a_step_with_coulombs_law_and_its_solution(tmp_path, dim, condense):
    """The solution in the file satisfies Coulomb's law, and is our solution."""
    h5py = pytest.importorskip("h5py")
    program = coulomb(dim=dim, condense=condense)
    with h5py.File(vx.write_program(program, tmp_path / "step.hdf5")) as file:
        local, solution = file["fclib_local"], {name: file["solution"][name][()] for name in ("u", "r")}
        assert (local["spacedim"][0], local["W"]["nz"][0]) == (dim, -2)
        W = read_sparse(local["W"])
        q, mu = (local["vectors"][name][()] for name in ("q", "mu"))
        about = json.loads(local["info"]["description"][()])
    assert about["energy_error"] == program.certificate.error <= 1e-8 * about["energy_norm"]
    r, u = solution["r"], W @ solution["r"] + q
    assert np.abs(u - solution["u"]).max() <= 8 * EPS * (abs(W) @ np.abs(r) + np.abs(q)).max()
    assert mu == pytest.approx(0.3)
    r_N, r_T, u_N, u_T = (part for x in (r, u) for part in (x.reshape(-1, dim)[:, 0], x.reshape(-1, dim)[:, 1:]))
    assert np.array_equal(r_N, program.answer.p)
    assert np.array_equal(r_T, -program.answer.lam)
    assert u_N == pytest.approx(-program.excess(program.answer.d), abs=1e-14)
    assert u_T == pytest.approx(program.slip(program.answer.d), abs=1e-14)
    assert 0 < (r_N > 0).sum() < len(r_N)
    assert (np.abs(u_T) > 1e-6).any()
    assert (u_N >= -1e-15).all()
    assert np.abs(r_N * u_N).max() < 1e-15
    assert (np.linalg.norm(r_T, axis=1) <= mu * r_N * (1 + 1e-12)).all()
    assert np.abs(mu * r_N * np.linalg.norm(u_T, axis=1) + (r_T * u_T).sum(axis=1)).max() < 1e-15


def test_other_laws_and_unsolved_programs_have_no_fclib_files(tmp_path):
    pytest.importorskip("h5py")
    given = coulomb(vx.TrescaFriction(0.1, on="bottom", while_closed=False))
    capped = coulomb(vx.CoulombFriction(0.3, on="bottom", cap=0.1))
    for program, says in (
        (given, "weights do not follow"),
        (capped, "weights are"),
        (solve("in space"), "solved step"),
    ):
        with pytest.raises(vx.ProgramError, match=says):
            vx.write_program(program, tmp_path / "step.hdf5")


def test_files_of_an_older_program_of_the_same_name_are_replaced(tmp_path):
    program = solve("friction")
    none = np.zeros(0)
    without = StepProgram(Operators(program.operators.K, sp.csr_matrix((0, len(program.g)))), program.g, none, none)
    for one in (program, without):
        assert len(vx.read_program(vx.write_program(one, tmp_path / "one.mtx")).w) == len(one.w)
