"""Programs as files: back to the bit, and read and solved by others, whose gaps are computed from the file alone."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache

import clarabel
import highspy
import numpy as np
import pytest
import scipy.sparse as sp
from reading_cbf import read_cbf, to_second_order
from scenes import mostly_long, small

import vemcvx as vx
from vemcvx.program import Operators, StepProgram
from vemcvx.vem import Space

EPS = float(np.finfo(float).eps)
TIMES = np.linspace(0.0, 1.0, 4)
FORMATS = "npz", "mtx", "cbf", "mps"


def press(x, t):
    return np.column_stack([np.full(len(x), 3 * t), np.full(len(x), -6.0 * t)])


def push(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


STEEL = vx.Elasticity(young=200.0, poisson=0.3)
FRICTION = vx.TrescaFriction(bound=4.0, on="bottom")
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


@cache
def solved(name, condense=True, n=3):
    return list(vx.programs(vx.Scene(*SCENES[name]), vx.meshes.squares(n), TIMES, condense=condense))[1]


def in_space(seed=0):
    """A program of blocks of two, as a surface in space has, with one soft limit."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(9, 9))
    operators = Operators(
        A @ A.T + np.eye(9),
        sp.csr_matrix(rng.normal(size=(6, 9))),
        block=2,
        D=sp.csr_matrix(rng.normal(size=(2, 9))),
        compliance=np.array([0.0, 0.3]),
    )
    return StepProgram(operators, 3 * rng.normal(size=9), np.full(3, 0.7), 0.1 * rng.normal(size=6), np.full(2, 0.05))


@mostly_long("condense", [True, False])
@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("form", FORMATS)
def test_programs_come_back(tmp_path, form, name, condense):
    """All data to the bit; K of a CBF as the product F'F, whose entries are sums of n products."""
    program, path = solved(name, condense), tmp_path / f"step.{form}"
    assert vx.write_program(program, path) == path
    back = vx.read_program(path)
    ours, theirs = program.operators, back.operators
    for one, two in ((program.g, back.g), (program.w, back.w), (program.b, back.b), (program.e, back.e)):
        assert np.array_equal(one, two)
    assert np.array_equal(ours.compliance, theirs.compliance)
    assert (ours.block, ours.features) == (theirs.block, theirs.features)
    assert (ours.B != theirs.B).nnz == (ours.D != theirs.D).nnz == 0
    off = abs(ours.K - theirs.K).max()
    # Each root is known to n eps, too; a K with a kernel has lost the anchors' part, 2^-8, to begin with.
    assert off <= (4 * len(program.g) * EPS * abs(ours.K).max() if form == "cbf" else 0.0)
    answer = program.answer
    found = back.certify(answer.d, answer.lam, answer.p)
    assert found.gap <= 4 * (program.certificate.gap + program.certificate.floor) + found.floor
    if form == "npz":
        assert isinstance(back, vx.SolvedProgram)
        # Beside a kernel factors of K differ in how they are anchored, and what rounds with them.
        floor = program.certificate.floor
        assert back.bounds == (
            program.bounds if ours.kernel is None else pytest.approx(program.bounds, rel=0, abs=floor)
        )


MESHES = {"voronoi": small("voronoi", 3), "tetrahedra": vx.meshes.tetrahedra(1)}


@pytest.mark.parametrize("family", MESHES)
def test_roots_of_cells_make_a_cbf_without_fill(family):
    """F'F = K but for rounding, and no row of F reads more than one cell; where supports eliminate unknowns, too."""
    mesh = MESHES[family]
    soft = vx.Elasticity(3.0, 0.48, stabilisation="unit")
    material = vx.Orthotropic((100.0, 50.0), 0.2, 20.0, angle=0.3) if family == "voronoi" else soft
    scene = vx.Scene(material, vx.Clamp(on="right"), vx.BilateralContact(on="bottom"))
    program = next(vx.programs(scene, mesh, [0.0, 1.0], condense=False))
    F, K = program.energy_rows(), program.operators.K
    # A cell adds a few products of numbers known to its own size, n dim <= 24, in eps.
    assert abs(F.T @ F - K).max() <= 24 * 24 * EPS * abs(K).max()
    most = max(group.nodes.shape[1] for group in Space(mesh).groups)
    assert np.diff(F.indptr).max() <= most * mesh.points.shape[1]
    assert next(vx.programs(scene, mesh, [0.0, 1.0])).energy_rows is None


def test_what_not_cells_alone_hold_has_no_such_roots(tmp_path):
    scene = vx.Scene(STEEL, vx.ElasticFoundation(normal=1.0, tangential=1.0, on="left"), *SCENES["friction"][2:])
    program = next(vx.programs(scene, vx.meshes.squares(2), [0.0, 1.0], condense=False))
    assert program.energy_rows is None
    back = vx.read_program(vx.write_program(program, tmp_path / "a.cbf"))
    assert (
        abs(back.operators.K - program.operators.K).max() <= 4 * len(program.g) * EPS * abs(program.operators.K).max()
    )


@pytest.mark.parametrize("form", ["npz", "mtx", "cbf"])
def test_cones_of_more_components_come_back(tmp_path, form):
    program, rng = in_space(), np.random.default_rng(1)
    back = vx.read_program(vx.write_program(program, tmp_path / f"a.{form}"))
    assert not isinstance(back, vx.SolvedProgram)
    d, lam, p = rng.normal(size=9), program.project(rng.normal(size=(3, 2))), rng.uniform(size=2)
    d = program.feasible(d)
    one, two = program.certify(d, lam, p), back.certify(d, lam, p)
    assert two.gap == pytest.approx(one.gap, rel=1e-12)


@pytest.mark.long
def test_words_say_what_it_is(tmp_path):
    """Beside every file: scene, mesh, step, the certified optimum and bounds on it, how degenerate, how conditioned."""
    program = solved("friction")
    vx.write_program(program, tmp_path / "a.npz")
    words = json.loads((tmp_path / "a.json").read_text())
    assert (words["step"], words["t"], words["format"]) == (2, TIMES[2], "vemcvx program 1")
    assert words["origin"]["mesh"]["cells"] == 9
    assert any("Elasticity" in line for line in words["origin"]["scene"])
    optimum = words["optimum"]
    assert optimum["low"] <= optimum["value"] <= optimum["high"]
    assert (optimum["low"], optimum["high"]) == program.bounds
    assert words["unknowns"] == len(program.g)
    assert words["nonzeros"]["B"] == program.operators.B.nnz
    # Equal programs give equal files.
    first = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    vx.write_program(program, tmp_path / "a.npz")
    assert first == {path.name: path.read_bytes() for path in tmp_path.iterdir()}


@pytest.mark.parametrize("form", FORMATS)
def test_the_kernel_of_a_body_that_floats_comes_back(tmp_path, form):
    """N, orthonormal, is one motion along the ground, wherever it is written or computed."""
    program = solved("free")
    back = vx.read_program(vx.write_program(program, tmp_path / f"a.{form}")).operators
    ours = program.operators.kernel
    assert ours.shape == back.kernel.shape == (len(program.g), 1)
    assert np.abs(back.kernel.T @ back.kernel - 1).max() < 1e-14
    assert abs(abs(float(ours[:, 0] @ back.kernel[:, 0])) - 1) < 1e-10
    assert np.abs(program.operators.K @ back.kernel).max() < 1e-12 * np.abs(program.operators.K).max()


@mostly_long("condense", [True, False])
@pytest.mark.parametrize("name", ["friction", "bounds", "soft"])
def test_highs_solves_the_qps(tmp_path, name, condense):
    """It reads the file; what it answers is certified by the program that is read from the same file."""
    program = solved(name, condense)
    vx.write_program(program, tmp_path / "step.mps")
    highs = highspy.Highs()
    highs.setOptionValue("output_flag", False)  # silent() prints a banner
    read, K = highs.readModel(str(tmp_path / "step.mps")), program.operators.K
    # Since 1.16 it warns of entries of K below 1e-9, zeros to the last digit, which it leaves out; of nothing else.
    small = (K != 0).sum() > (abs(K) > 1e-9).sum()
    assert read == highspy.HighsStatus.kOk or (small and read == highspy.HighsStatus.kWarning)
    assert highs.getNumCol() == len(program.g) + len(program.w) + int((program.operators.compliance > 0).sum())
    highs.run()
    assert highs.modelStatusToString(highs.getModelStatus()) == "Optimal"
    back, m, n = vx.read_program(tmp_path / "step.mps"), len(program.w), len(program.g)
    x, duals = np.array(highs.getSolution().col_value), -np.array(highs.getSolution().row_dual)
    lam, p = duals[:m] - duals[m : 2 * m], duals[2 * m :]
    d = back.feasible(x[:n])
    found = back.certify(d, lam, p)
    away = d - program.answer.d
    bound = found.error + found.error_floor + program.certificate.error + program.certificate.error_floor
    assert np.sqrt(away @ program.operators.K @ away) <= bound
    low, high = program.bounds
    # Its own regularisation of the Hessian, 1e-7, and tolerances of 1e-7.
    assert low - 1e-6 <= highs.getInfo().objective_function_value <= high + 1e-6
    assert found.gap < 1e-6


@mostly_long("condense", [True, False])
@pytest.mark.parametrize("name", ["friction", "bounds", "soft", "free", "in space"])
def test_clarabel_solves_the_cbf(tmp_path, name, condense):
    """Through a reader of the format that knows nothing of us: the optimum lies within the bounds."""
    program = in_space() if name == "in space" else solved(name, condense)
    vx.write_program(program, tmp_path / "step.cbf")
    cost, A, b, cones = to_second_order(*read_cbf((tmp_path / "step.cbf").read_text()))
    kinds = {"Q": clarabel.SecondOrderConeT, "L+": clarabel.NonnegativeConeT}
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    # A x + b in the cone is b - (-A) x = s in the cone.
    found = clarabel.DefaultSolver(
        sp.csc_matrix((len(cost), len(cost))),
        cost,
        sp.csc_matrix(-A),
        b,
        [kinds[kind](size) for kind, size in cones],
        settings,
    ).solve()
    assert str(found.status) == "Solved"
    back, n, block = vx.read_program(tmp_path / "step.cbf"), len(program.g), program.operators.block
    d, z, start = np.array(found.x)[:n], np.array(found.z), cones[0][1]
    terms = z[start : start + len(program.w) * (1 + block)].reshape(-1, 1 + block)
    certificate = back.certify(back.feasible(d), -terms[:, 1:], z[start + terms.size :])
    # Tolerances are 1e-8 of numbers of size one.
    assert certificate.gap < 1e-6
    assert terms[:, 0] == pytest.approx(program.w, abs=1e-6)
    low, high = program.bounds if name != "in space" else [program.objective(back.feasible(d))] * 2
    assert low - 1e-6 <= found.obj_val <= high + 1e-6


@pytest.mark.long
def test_what_cannot_be_written_or_read_is_refused(tmp_path):
    program = solved("friction")
    nothing = next(vx.programs(vx.Scene(*SCENES["friction"][:3]), vx.meshes.squares(2), TIMES))
    (tmp_path / "file").touch()
    write = {
        "a.lp": (program, "there is no format '.lp'; there are .npz, .mtx, .cbf, .mps, .qps, .hdf5."),
        "b.qps": (in_space(), "MPS has no second-order cones, which this program has; write .cbf, .npz or .mtx."),
        "c.npz": (SCENES, "wanted a StepProgram, as history.program(n) is."),
        "f.cbf": (replace(solved("free", condense=False), energy_rows=None), "take the condensed program"),
        "d.npz": (nothing, "no unknowns left; use condense=False (--no-condense)."),
        "file/e.npz": (program, "cannot be written"),
    }
    for name, (what, words) in write.items():
        with pytest.raises(vx.ProgramError, match=re.escape(words)):
            vx.write_program(what, tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    read = {
        "a.npz": (b"PK", "a.npz: the file is damaged, or no .npz file"),
        "b.mtx": (b"%%MatrixMarket matrix array real general\n1 1\n1\n", "b.mtx: found no g"),
        "c.cbf": (b"VER\n1\n", "only files written by write_program() can be read"),
        "d.qps": (b"NAME x\nENDATA\n", "only files written by write_program() can be read"),
    }
    for name, (data, words) in read.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(vx.ProgramError, match=re.escape(words)):
            vx.read_program(tmp_path / name)
    with pytest.raises(vx.ProgramError, match="there is no such file"):
        vx.read_program(tmp_path / "f.npz")
    vx.write_program(program, tmp_path / "g.npz")
    kept = dict(np.load(tmp_path / "g.npz"))
    wrong = {
        "w": (-kept["w"], "weights >= 0"),
        "g": (kept["g"][1:], "found K of shape"),
        "b": (kept["b"] + np.nan, "NaN"),
    }
    for name, (value, says) in wrong.items():
        np.savez(tmp_path / "h.npz", **{**kept, name: value})
        with pytest.raises(vx.ProgramError, match=f"h.npz: .*{says}"):
            vx.read_program(tmp_path / "h.npz")


def coulomb(law, n=4, condense=True):
    scene = vx.Scene(
        STEEL, vx.Clamp(on="top"), vx.Traction(press, on="left"), vx.UnilateralContact(gap=1e-3, on="bottom"), law
    )
    return list(vx.programs(scene, vx.meshes.squares(n), TIMES, condense=condense))[-1]


def coulomb_in_space(condense=True):
    """A pad that a plate presses, drags and twists."""

    def plate(x, t):
        y = x[:, 1] - 0.5
        return np.column_stack([0.02 * t - 0.03 * t * y, 0.03 * t * (x[:, 0] - 0.2), np.full(len(x), -0.01)])

    scene = vx.Scene(
        STEEL,
        vx.PrescribedDisplacement(plate, on="top"),
        vx.UnilateralContact(gap=lambda x, t: 0.02 * x[:, 0] ** 2, on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
    )
    return list(vx.programs(scene, vx.meshes.cubes(3), TIMES, initial="settled", condense=condense))[-1]


@pytest.mark.long
@pytest.mark.parametrize("dim", [2, 3])
def test_a_step_with_coulombs_law_as_fclib_has_it(tmp_path, dim):
    """Read by h5py as its C library does; the solution in the file solves the file's problem, and is ours."""
    h5py = pytest.importorskip("h5py")
    program = coulomb(vx.CoulombFriction(0.3, on="bottom")) if dim == 2 else coulomb_in_space()
    with h5py.File(vx.write_program(program, tmp_path / "step.hdf5")) as file:
        local, solution = file["fclib_local"], {name: file["solution"][name][()] for name in ("u", "r")}
        assert local["spacedim"][0] == dim
        size, kind = (int(local["W"][name][0]) for name in ("m", "nz"))
        assert kind == -2
        W = sp.csr_matrix((local["W"]["x"][()], local["W"]["i"][()], local["W"]["p"][()]), shape=(size, size))
        q, mu = (local["vectors"][name][()] for name in ("q", "mu"))
        assert "u = W r + q" in local["info"]["math_info"][()].decode()
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


@mostly_long("dim", [2, 3], 1)
def test_all_unknowns_are_fclibs_global_problem(tmp_path, dim):
    """M v = H r + f and u = H'v + w, from the file alone; Coulomb's law is tested for the local problem above."""
    h5py = pytest.importorskip("h5py")
    made = coulomb_in_space if dim == 3 else lambda condense: coulomb(vx.CoulombFriction(0.3, on="bottom"), 4, condense)
    program = made(condense=False)
    with h5py.File(vx.write_program(program, tmp_path / "step.hdf5")) as file:
        problem, solution = file["fclib_global"], {name: part[()] for name, part in file["solution"].items()}
        assert problem["spacedim"][0] == dim
        M, H = (
            sp.csr_matrix((A["x"][()], A["i"][()], A["p"][()]), shape=(A["m"][0], A["n"][0]))
            for A in (problem["M"], problem["H"])
        )
        f, w, mu = (problem["vectors"][name][()] for name in ("f", "w", "mu"))
        about = json.loads(problem["info"]["description"][()])
    assert about["energy_error"] == program.certificate.error <= 1e-8 * about["energy_norm"]
    assert (M != program.operators.K).nnz == 0
    assert H.shape == (len(f), dim * len(mu)) == (len(solution["v"]), len(w))
    v, r = solution["v"], solution["r"]
    assert np.array_equal(solution["u"], H.T @ v + w)
    off = M @ v - H @ r - f
    assert 0.5 * off @ np.linalg.solve(M.toarray(), off) <= program.certificate.gap + program.certificate.floor


@pytest.mark.parametrize(
    ("law", "says"),
    [
        (vx.TrescaFriction(0.1, on="bottom", while_closed=False), "weights do not follow the pressure"),
        (vx.CoulombFriction(0.3, on="bottom", cap=0.1), "weights are capped"),
    ],
)
def test_what_fclib_has_no_model_for(law, says, tmp_path):
    pytest.importorskip("h5py")
    with pytest.raises(vx.ProgramError, match=says):
        vx.write_program(coulomb(law), tmp_path / "step.hdf5")
    operators = Operators(np.eye(1), sp.csr_matrix(np.eye(1)))
    with pytest.raises(vx.ProgramError, match="only a solved step has"):
        vx.write_program(StepProgram(operators, *np.ones((2, 1)), np.zeros(1)), tmp_path / "a.hdf5")
    (tmp_path / "b.hdf5").write_bytes(b"")
    with pytest.raises(vx.ProgramError, match="states Coulomb's law, no convex program"):
        vx.read_program(tmp_path / "b.hdf5")


def test_nothing_is_left_of_another_program_of_that_name(tmp_path):
    with_terms, without = solved("friction"), replace_terms(solved("friction"))
    for program in (with_terms, without):
        read = vx.read_program(vx.write_program(program, tmp_path / "one.mtx"))
        assert len(read.w) == len(program.w)


def replace_terms(program):
    """The program without its norm terms."""
    K, none = program.operators.K, np.zeros(0)
    return StepProgram(Operators(K, sp.csr_matrix((0, len(program.g)))), program.g, none, none)
