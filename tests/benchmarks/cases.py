"""The benchmarks: the paper's reference run, a block in space, the assembly, and runs with up to a million unknowns."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import skfem
from measure import Row, alternate, in_a_process, in_turn
from paper_scene import POISSON, YOUNG
from reference import assemble_elasticity, grid, time_user_step

import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure, plain_logarithms
from vemcvx.plots.style import MARKERS, SERIES
from vemcvx.vem import Space, stiffness

HEAD = """
import statistics, sys, time
sys.path.insert(0, {folder!r})
import numpy as np, vemcvx as vx
from paper_scene import {scene} as SCENE
mesh, marks = vx.meshes.{family}({n}), []
"""
FACTOR = """
import scipy.sparse as sp
from reference import factor_and_solve
from vemcvx.scene import pose_scene
system = pose_scene(SCENE, mesh).system
K, f = sp.csc_matrix(system.K), system.force(1.0)
wall, cpu = time.perf_counter(), time.process_time()
factor_and_solve(K, f)
out = dict(seconds=time.perf_counter() - wall, cpu=time.process_time() - cpu, unknowns=system.n)
"""
SIMULATE = """
wall, cpu = time.perf_counter(), time.process_time()
h = vx.simulate(SCENE, mesh, np.linspace(0, 1, {steps} + 1), solver={solver}, linear={linear}, store="{store}",
                progress=lambda *_: marks.append(time.perf_counter()))
out = dict(seconds=time.perf_counter() - wall, cpu=time.process_time() - cpu, step=statistics.median(np.diff(marks)),
           unknowns=h.trajectory.state.shape[1], certified=float(h.trajectory.certificate.max()),
           **{{name: h.seconds[name] for name in ("assemble", "prepare", "solve")}})
"""
LINEAR = {"SuperLU": "vx.SuperLU()", "PARDISO": "vx.Pardiso()"}


def program(body: str, n: int, **given: object) -> str:
    """Return the text of a program for a new process."""
    where = {"scene": "SCENE", "family": "squares", "store": "last", **given}
    return (HEAD + body).format(folder=str(Path(__file__).parent), n=n, **where)


def measure_paper(n: int) -> list[Row]:
    """Measure the paper's reference run (h = k = 1/n) against one factorisation and one solve of its matrix."""
    newton = {
        name: program(SIMULATE, n, steps=n, solver="vx.Newton(accuracy=1e-8)", linear=text)
        for name, text in LINEAR.items()
    }
    found = in_turn({"T0": program(FACTOR, n), **newton})
    clarabel = {
        name: program(SIMULATE, n, steps=n, solver="vx.Clarabel(accuracy=1e-6)", linear=text)
        for name, text in LINEAR.items()
    }
    slow = in_turn(clarabel, repeats=1)
    t0 = found["T0"]
    one = f"T0: splu factor and solve, {t0['unknowns']:.0f} unknowns"

    def row(name: str, run: dict[str, float], wanted: str) -> Row:
        return Row(name, run["seconds"], one, t0["seconds"], wanted, run["cpu"], t0["cpu"])

    def part(name: str, seconds: float, wanted: str) -> Row:
        return Row(name, seconds, one, t0["seconds"], wanted)

    rows = []
    for name, wanted in (("SuperLU", "<= 1.4"), ("PARDISO", "<= 0.55")):
        run = found[name]
        rows += [
            row(f"simulate, {n} steps, Newton 1e-8, {name}", run, wanted),
            part(f"in this run: assembling and preparing, {name}", run["assemble"] + run["prepare"], ""),
            part(f"in this run: {n} steps, {name}", run["solve"], "<= 0.15"),
            part(f"one step after set-up, median, {name}", run["step"], "<= 0.0006"),
        ]
    rows += [row(f"simulate, {n} steps, Clarabel 1e-6, {name}", slow[name], "<= 5") for name in LINEAR]
    what = f"{n} full-size steps, scikit-fem + cvxpy + Clarabel ({n} times the time of one step)"
    return [*rows, Row(what, time_user_step(n) * n, "the same by simulate", slow["SuperLU"]["seconds"], ">= 100")]


def measure_space(n: int, steps: int = 16) -> list[Row]:
    """Measure a block of n x n x n cubes against one factorisation and one solve of its matrix."""
    given = {"scene": "BLOCK", "family": "cubes"}
    solvers = {"PARDISO": "vx.Pardiso()", "SuperLU": "vx.SuperLU()"}
    newton = {
        name: program(SIMULATE, n, steps=steps, solver="vx.Newton(accuracy=1e-8)", linear=text, **given)
        for name, text in solvers.items()
    }
    found = in_turn({"T0": program(FACTOR, n, **given), **newton}, repeats=1)
    t0 = found["T0"]
    one, rows = f"T0: splu factor and solve, {t0['unknowns']:.0f} unknowns in space", []
    for name, wanted, step in (("PARDISO", "<= 0.3", "<= 0.01"), ("SuperLU", "", "")):
        run = found[name]
        whole = f"cubes, {steps} steps, Newton 1e-8, {name}"
        rows.append(Row(whole, run["seconds"], one, t0["seconds"], wanted, run["cpu"], t0["cpu"]))
        rows.append(Row(f"cubes, one step after set-up, median, {name}", run["step"], one, t0["seconds"], step))
    return rows


def measure_assembly(n: int) -> list[Row]:
    """Measure the assembly of K: the package against scikit-fem, and Voronoi cells against distorted squares."""
    rows = []
    for family, kind in (("squares", skfem.MeshQuad), ("triangles", skfem.MeshTri)):
        mesh, theirs = getattr(vx.meshes, family)(n), grid(n, kind)
        ours, other = alternate(partial(assemble, mesh), partial(assemble_elasticity, theirs), repeats=5)
        rows.append(Row(f"assembly of K, {family}, {2 * mesh.n_nodes} unknowns", ours, "scikit-fem", other, "<= 1"))
    # Voronoi meshes have two nodes per cell. Squares are distorted, because equal squares share one local matrix.
    voronoi, quadrangles = vx.meshes.voronoi(n, cells=n * n // 2), vx.meshes.distorted(n)
    ours, other = alternate(partial(assemble, voronoi), partial(assemble, quadrangles), repeats=5)
    what = f"assembly of K, voronoi, {2 * voronoi.n_nodes} unknowns"
    rows.append(Row(what, ours, "distorted squares", other, "<= 1.5"))
    return rows


def assemble(mesh: vx.PolygonMesh) -> sp.csr_matrix:
    """Assemble K of a mesh, without caches of earlier calls."""
    mu = YOUNG / (2 * (1 + POISSON))
    lam = 2 * mu * POISSON / (1 - 2 * POISSON)
    return stiffness(Space(mesh), np.full(mesh.n_cells, lam), np.full(mesh.n_cells, mu))


def measure_growth(sizes: list[int], linear: str) -> list[dict]:
    """Measure 20 certified steps on finer and finer squares, each size in a new process."""
    given = {"steps": 20, "solver": "vx.Newton(accuracy=1e-8)", "linear": LINEAR[linear]}
    return [in_a_process(program(SIMULATE, n, **given)) for n in sizes]


def growth_row(growth: list[dict], linear: str) -> Row:
    """Return a row with the exponent p of time = O(unknowns^p), from the smallest and the largest size."""
    first, last = growth[0], growth[-1]
    name = (
        f"logarithm of the ratio of times, {first['unknowns']} to {last['unknowns']} unknowns, 20 steps, {linear} "
        f"(largest: {last['seconds']:.0f} s, {last['peak_gb']:.1f} GB, certified {last['certified']:.0e})"
    )
    return Row(
        name,
        np.log(last["seconds"] / first["seconds"]),
        "logarithm of the ratio of unknowns",
        np.log(last["unknowns"] / first["unknowns"]),
        "<= 1.3",
    )


def draw_picture(growths: dict[str, list[dict]], path: Path) -> None:
    """Draw time and memory against unknowns."""
    figure = new_figure(9.4, 3.2)
    time, memory = figure.subplots(1, 2)
    for (name, growth), colour, mark in zip(growths.items(), SERIES, MARKERS, strict=False):
        unknowns = np.array([row["unknowns"] for row in growth])
        for ax, what in ((time, "seconds"), (memory, "peak_gb")):
            ax.loglog(unknowns, [row[what] for row in growth], f"{mark}-", color=colour, markersize=5, label=name)
    slope = growth[0]["seconds"] * (unknowns / unknowns[0]) ** 1.3
    time.loglog(unknowns, slope, ":", color="0.4", label="unknowns$^{1.3}$")
    time.set(ylabel="time (s)")
    time.set_title("20 certified frictional steps on squares", fontsize="medium")
    memory.set(ylabel="largest memory (GB)")
    memory.set_title("memory of these runs", fontsize="medium")
    for ax in (time, memory):
        ax.set(xlabel="unknowns")
        plain_logarithms(ax.yaxis)
        light_grid(ax)
        ax.legend(frameon=False, fontsize="small")
    figure.savefig(path, dpi=100)
