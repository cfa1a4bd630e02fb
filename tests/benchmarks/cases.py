"""The benchmarks: the paper's reference run, assembly, growth to a million unknowns, imports."""

from __future__ import annotations

import statistics
import time
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import skfem
from measure import Row, alternate, in_a_process
from reference import BOUND, POISSON, YOUNG, elasticity, factor_and_solve, grid, user_step

import vemcvx as vx
from vemcvx.scene.pose import pose_scene
from vemcvx.vem import Space, stiffness


def pull(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


SCENE = vx.Scene(
    vx.Elasticity(YOUNG, POISSON),
    vx.Clamp(on="right"),
    vx.Traction(pull, on="left"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(BOUND, on="bottom"),
)


def paper(n: int) -> list[Row]:
    """The paper's reference run (h = k = 1/n) against one factorisation and one solve of the same matrix."""
    mesh, times = vx.meshes.squares(n), np.linspace(0, 1, n + 1)
    system = pose_scene(SCENE, mesh).system
    K, f = sp.csc_matrix(system.K), system.force(1.0)
    marks: list[float] = []

    def run(solver: vx.Solver) -> None:
        marks.clear()
        vx.simulate(
            SCENE, mesh, times, solver=solver, store="last", progress=lambda *_: marks.append(time.perf_counter())
        )

    t0, newton = alternate(lambda: factor_and_solve(K, f), lambda: run(vx.Newton(accuracy=1e-8)))
    step = statistics.median(np.diff(marks))
    again, clarabel = alternate(lambda: factor_and_solve(K, f), lambda: run(vx.Clarabel(accuracy=1e-6)), repeats=1)
    full = user_step(n)
    one = f"T0: splu factor and solve, {system.n} unknowns"
    return [
        Row(f"simulate, {n} steps, Newton 1e-8", newton, one, t0, "<= 1.5"),
        Row("one step after set-up, Newton, median", step, one, t0, "<= 0.005"),
        Row(f"simulate, {n} steps, Clarabel 1e-6", clarabel, one, again, "<= 7"),
        Row(
            f"{n} full-size steps, scikit-fem + cvxpy + Clarabel (one measured)",
            full * n,
            "the same by simulate",
            clarabel,
            ">= 100",
        ),
    ]


def assembly(n: int) -> list[Row]:
    """Assembly of K against scikit-fem on the same meshes, and on Voronoi cells with as many unknowns."""
    rows = []
    seconds = {}
    for family, kind in (("squares", skfem.MeshQuad), ("triangles", skfem.MeshTri)):
        mesh, theirs = getattr(vx.meshes, family)(n), grid(n, kind)
        ours, other = alternate(lambda mesh=mesh: assemble(mesh), lambda theirs=theirs: elasticity(theirs), repeats=5)
        rows.append(Row(f"assembly of K, {family}, {2 * mesh.n_nodes} unknowns", ours, "scikit-fem", other, "<= 1"))
        seconds[family] = ours
    # Three cells meet at a node of a Voronoi mesh: two nodes a cell.
    voronoi, squares = vx.meshes.voronoi(n, cells=n * n // 2), vx.meshes.squares(n)
    ours, other = alternate(lambda: assemble(voronoi), lambda: assemble(squares), repeats=5)
    rows.append(Row(f"assembly of K, voronoi, {2 * voronoi.n_nodes} unknowns", ours, "squares", other, "<= 1.5"))
    return rows


def assemble(mesh: vx.PolygonMesh) -> sp.csr_matrix:
    """K of a mesh, nothing remembered from an earlier call."""
    mu = YOUNG / (2 * (1 + POISSON))
    lam = 2 * mu * POISSON / (1 - 2 * POISSON)
    return stiffness(Space(mesh), np.full(mesh.n_cells, lam), np.full(mesh.n_cells, mu))


GROWTH = """
import sys, time
sys.path.insert(0, {folder!r})
import numpy as np, vemcvx as vx
from cases import SCENE
mesh = vx.meshes.squares({n})
start = time.perf_counter()
h = vx.simulate(SCENE, mesh, np.linspace(0, 1, 21), solver=vx.Newton(accuracy=1e-8), store="last")
out = dict(n={n}, unknowns=h.trajectory.state.shape[1], seconds=time.perf_counter() - start,
           certified=float(h.trajectory.certificate.max()), **h.seconds)
"""


def growth(sizes: list[int]) -> list[dict]:
    """20 certified steps on ever finer squares, each in a process of its own for its peak memory."""
    return [in_a_process(GROWTH.format(folder=str(Path(__file__).parent), n=n)) for n in sizes]


def growth_row(growth: list[dict]) -> Row:
    """The exponent of total time between the smallest and the largest size, as a ratio of logarithms."""
    first, last = growth[0], growth[-1]
    name = (
        f"growth of time, {first['unknowns']} to {last['unknowns']} unknowns, 20 steps (log ratio; largest: "
        f"{last['seconds']:.0f} s, {last['peak_gb']:.1f} GB, certified {last['certified']:.0e})"
    )
    return Row(
        name,
        np.log(last["seconds"] / first["seconds"]),
        "growth of unknowns",
        np.log(last["unknowns"] / first["unknowns"]),
        "<= 1.3",
    )


def imports() -> list[Row]:
    """Importing the package against importing what it stands on."""
    code = (
        "import time; t = time.perf_counter(); import numpy, scipy.sparse{more}; out = dict(s=time.perf_counter() - t)"
    )
    bare, ours = alternate(
        lambda: in_a_process(code.format(more="")), lambda: in_a_process(code.format(more=", vemcvx")), repeats=5
    )
    return [Row("import vemcvx (whole process)", ours, "import numpy, scipy.sparse", bare, "0.6 s more")]


def picture(rows: list[Row], growth: list[dict], path: Path) -> None:
    """Ratios as bars against what is wanted, and time and memory against unknowns."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    shown = rows[:-1][::-1]
    left.plot([row.ratio for row in shown], range(len(shown)), "o", color="#33658a")
    left.axvline(1.0, color="#777777", linewidth=0.8)
    for place, row in enumerate(shown):
        left.annotate(
            f"{row.ratio:.3g}", (row.ratio, place), (6, 0), textcoords="offset points", va="center", fontsize=7
        )
    names = [f"{row.name}\nagainst {row.reference}" for row in shown]
    left.set_yticks(range(len(shown)), names, fontsize=6)
    left.set(xscale="log", xlabel="time as a multiple of the reference", title="Ratios, measured side by side")
    left.set_xlim(right=8 * max(row.ratio for row in shown))
    left.grid(axis="x", alpha=0.3)
    unknowns = np.array([row["unknowns"] for row in growth])
    right.loglog(unknowns, [row["seconds"] for row in growth], "o-", color="#33658a", label="seconds")
    right.loglog(unknowns, [row["peak_gb"] for row in growth], "s--", color="#f26419", label="peak memory, GB")
    slope = growth[0]["seconds"] * (unknowns / unknowns[0]) ** 1.3
    right.loglog(unknowns, slope, ":", color="#777777", label="unknowns$^{1.3}$")
    right.set(xlabel="unknowns", title="20 certified frictional steps on squares")
    right.legend(frameon=False)
    figure.savefig(path, dpi=150)
