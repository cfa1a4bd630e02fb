"""The figures and the table of Feng, Han and Huang, Section 4, by one command.

    python problems/paper_figures.py [--out DIR]

The command draws four figures and prints their data: the meshes (Fig. 1), the tangential displacement on each mesh
(Fig. 2), errors relative to a run with cells and time steps of 1/256 (Table 1 and Fig. 3), and the numbers of nodes of
polygon and triangle meshes (Fig. 4). The paper's printed numbers are listed beside our numbers: first for the
stabilisation S_K of (3.13), then for 2 mu S_K, our default. The notes below the tables state the differences and their
known causes.

S_K has the factor 1 in place of 2 mu = 154 daN/mm^2. Displacements that the projection Pi maps to zero then need very
small forces. The loads bend the cells on which they act, and less of the load reaches the contact. With 96 cells a side
and the time step 1/8, the largest slips at t = 1 are .0114 to .0115 mm on all meshes with the factor 2 mu. With the
factor 1 they are .0114 mm on squares, .0113 mm on Voronoi cells and hexagons, and .0076 mm on nonconvex cells. With 24
nonconvex cells a side and the factor 1, nothing slips. In other units, such as N instead of daN, S_K gives other slips.

The command also prints the deviations of the package from the text of the paper, and the options that undo the
deviations. This command prints only the deviations:

    python problems/paper_figures.py --deviations
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))

import feng_han_huang as paper
import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure, plain_logarithms
from vemcvx.plots.style import MARKERS, SERIES

FAMILIES = ("squares", "voronoi", "hexagons", "nonconvex")
"""Fig. 1 shows four types of meshes. The text names two: squares, and polygons of the generator of Talischi et al.
We chose the other two."""
SIZES, REFERENCE = (4, 8, 16, 32, 64), 256
PRINTED_ERRORS = {4: 0.1745, 8: 0.0911, 16: 0.0458, 32: 0.0221, 64: 0.0099}
PRINTED_NODES = {50: (99, 36), 200: (400, 121), 800: (1601, 441), 5000: (9986, 2601)}
STABILISATIONS = {"unit": "S_K of (3.13) to the letter", "shear": "2 mu S_K, our default"}
KINDS = ("exact", "projected", "nodal", "consistent")
COLOURS = {"printed": "black", "exact": "#0072B2", "projected": "#009E73", "nodal": "#D55E00", "consistent": "#CC79A7"}
MARKS = {"printed": "*", "exact": "o", "projected": "s", "nodal": "^", "consistent": "v"}
DPI = 110
DEVIATIONS = (
    (
        "S_K(v, w) = sum_i chi_i(v) chi_i(w), without a unit, in (3.13)",
        "2 mu S_K",
        '`Elasticity(..., stabilisation="unit")`',
    ),
    (
        "j(v) = int g abs(v_tau), also if v_tau changes its sign on an edge",
        "sum_i g(x_i) abs(v_tau(x_i)) int phi_i: at least j(v) for constant g; the difference is O(h^2)",
        'none; `TrescaFriction(..., quadrature="integral")`, sum_i abs(v_tau(x_i)) int g phi_i, equals j(v) if the '
        "slip keeps its sign along each edge, as in the example",
    ),
    (
        "u_0^hk = P^h u_0, (2.11), (2.14), (3.26)",
        "u_0 = 0, as in the example",
        "`simulate(..., initial=vx.projected(u_0, settle=False))`, except for the next row",
    ),
    (
        "a^h(P^h u_0, v) = a(u_0, v), (2.11)",
        "`vx.projected` replaces C eps(u_0) by its mean over each cell, because only the mean strain of a virtual v "
        "can be computed: an error O(h), zero for linear u_0",
        "none: the right side cannot be computed",
    ),
    (
        "(2.6), l^h(0) = l(0), implies (2.13); the l^h of Section 3 violates (2.6) if f_1(0) is not 0",
        "`vx.projected` solves one step at times[0] that starts from P^h u_0. The run begins at the answer of this "
        "step, which satisfies (2.13); the distance from this answer to P^h u_0 is O(h)",
        "`vx.projected(u_0, settle=False)` begins at P^h u_0, as (3.26) says",
    ),
    (
        "the bound of friction g(x) does not depend on time",
        "any g(x, t) >= 0, evaluated at the end of each step",
        "a number, or a function that does not use t",
    ),
    (
        "u = 0 on Gamma_D",
        "`Clamp`, or `PrescribedDisplacement(value)` with any value(x, t)",
        "`Clamp`",
    ),
    (
        "Fig. 1 has four types of meshes; the text names squares (Table 1) and the generator of Talischi et al.",
        "`squares`; `voronoi`, made by the same method; `hexagons` and `nonconvex`, our choice",
        "`vx.meshes.voronoi(shortest=0.0)` keeps short edges; `vx.meshes.read` reads any mesh",
    ),
    (
        "f_2 acts on Gamma_F; the text does not say that this is the left side",
        '`Traction(..., on="left")`, the remaining side',
        'none; `on="left"` is a name of the mesh',
    ),
    (
        "norm(v)_E = (int C eps : eps / 2)^(1/2)",
        "`Measured.absolute` has no factor 1/2",
        "`absolute / sqrt(2)`; relative errors are the same",
    ),
    (
        "norm(u_ref - u_h)_E of the virtual functions",
        '`measures.energy_distance` of Pi u_h, `kind="projected"`',
        '`kind="exact"` on squares, where virtual functions are bilinear; none on other polygons',
    ),
    (
        "h = max h_K, the diameter",
        "h = 1/n in the tables, the side of n x n squares, which is 1/sqrt(2) times the diameter; orders are the same",
        "`mesh.diameters.max()`",
    ),
    (
        "an adaptive semi-smooth Newton method [24]",
        "active sets by Newton's method, with a certificate",
        "`simulate(..., solver=...)`; the answer of a step is unique",
    ),
)
"""Columns: the paper, the package by default, and the option that follows the paper. There are no other deviations."""


def figure_1(n: int = 8):
    """Draw the four types of meshes."""
    figure = new_figure(10.0, 2.9)
    for ax, family in zip(figure.subplots(1, 4), FAMILIES, strict=True):
        mesh = paper.mesh(n, family)
        mesh.plot(ax=ax, linewidth=0.7)
        ax.set(xlim=(-0.02, 1.02), ylim=(-0.02, 1.02))
        ax.set_title(f"{family}: {mesh.n_cells} cells, {mesh.n_nodes} nodes", fontsize="medium")
        ax.set_axis_off()
    return figure


def figure_2(n: int = 24, steps: int = 64, stabilisation: str = "unit"):
    """Draw u_1 at t = 1 over the body and along the contact boundary, on each type of mesh."""
    scene = paper.scene(stabilisation=stabilisation)
    runs = {f: vx.simulate(scene, paper.mesh(n, f), paper.times(steps), store="last") for f in FAMILIES}
    largest = max(run.displacement[-1, :, 0].max() for run in runs.values())
    figure = new_figure(10.0, 6.4)
    rows = figure.subfigures(2, 1, height_ratios=[1.0, 1.15])
    panels = rows[0].subplots(1, 4)
    for ax, (family, run) in zip(panels, runs.items(), strict=True):
        cells = body(ax, run)
        cells.set(clim=(0.0, largest))
        ax.set_title(f"{family}, {run.mesh.n_cells} cells", fontsize="medium")
    rows[0].colorbar(cells, ax=panels, label="$u_1$ (mm)", shrink=0.85, pad=0.01)
    below = rows[1].subplots()
    for (family, run), mark, colour in zip(runs.items(), MARKERS, SERIES, strict=False):
        contact = run.contact
        order = np.argsort(contact.points[:, 0])
        x, slip = contact.points[order, 0], contact.slip[-1, order, 0]
        below.plot(x, slip, mark + "-", color=colour, mfc="none", ms=6, lw=0.8, label=family)
    below.set(xlabel="$x_1$ along the contact boundary (mm)", ylabel=r"$u_\tau$ at $t = 1$ (mm)", xlim=(-0.01, 1.01))
    below.axhline(0.0, color="0.6", lw=0.6)
    light_grid(below)
    below.legend(frameon=False)
    return figure, runs


def body(ax, run):
    """Draw the body; the colour of a cell is the mean of u_1 over its vertices."""
    mesh, u = run.mesh, run.displacement[-1, :, 0]
    mesh.plot(ax=ax, linewidth=0.15, edgecolor="0.4")
    cells = ax.collections[0]
    cells.set_array(np.add.reduceat(u[mesh.vertices], mesh.offsets[:-1]) / np.diff(mesh.offsets))
    cells.set_cmap("viridis")
    ax.set(xlim=(0, 1), ylim=(0, 1))
    ax.set_axis_off()
    return cells


Errors = dict[str, list[vx.measures.Measured]]


def errors(sizes: Sequence[int] = SIZES, reference: int = REFERENCE, stabilisation: str = "unit") -> Errors:
    """Return distances at t = 1 between the reference run and runs on squares with h = k = 1/n, by every measure."""
    scene = paper.scene(stabilisation=stabilisation)
    fine = vx.simulate(scene, paper.mesh(reference), paper.times(reference), store="last")
    found: Errors = {kind: [] for kind in (*KINDS, "nodal, 2 mu", "in time")}
    for n in sizes:
        run = vx.simulate(scene, paper.mesh(n), paper.times(n), store="last")
        for kind in KINDS[:3]:
            found[kind].append(vx.measures.energy_distance(run, fine, kind=kind))
        at_nodes = vx.measures.Field(run.mesh, fine.probe(run.mesh.points)[-1], run.moduli)
        found["consistent"].append(vx.measures.energy_distance(run, at_nodes))
        in_ours = vx.measures.Field(run.mesh, run.displacement[-1], run.moduli, stabilisation="shear")
        found["nodal, 2 mu"].append(vx.measures.energy_distance(in_ours, fine, kind="nodal"))
        many = vx.simulate(scene, run.mesh, paper.times(reference), store="last")
        found["in time"].append(vx.measures.energy_distance(run, many, kind="nodal"))
    return found


def table_1(found: Errors, sizes: Sequence[int]) -> dict[str, vx.measures.ConvergenceTable]:
    """Return Table 1: relative errors with their orders, then absolute errors in the paper's norm."""
    h = 1 / np.array(sizes)
    relative = {kind: [one.relative for one in found[kind]] for kind in KINDS}
    absolute = {kind: [one.absolute / np.sqrt(2) for one in found[kind]] for kind in KINDS}
    printed = [PRINTED_ERRORS.get(n, np.nan) for n in sizes]
    return {
        "relative energy errors at t = 1 on squares, h = k, and observed orders": (
            vx.measures.convergence_table(h, {"printed": printed, **relative}, "h = k")
        ),
        "absolute energy errors: ||v||_E = (1/2 int C eps : eps)^(1/2), (daN mm)^(1/2) at 1 mm thickness": (
            vx.measures.convergence_table(h, absolute, "h = k")
        ),
    }


def notes_on_table_1(every: dict[str, Errors], sizes: Sequence[int]) -> list[str]:
    """Return sentences about the differences from the printed numbers."""
    h = 1 / np.array(sizes)
    slopes = {
        name: vx.measures.orders(h, [one.relative for one in found["exact"]]).slope for name, found in every.items()
    }
    of_ours = ", ".join(f"{one.relative:.3f}" for one in every["unit"]["nodal, 2 mu"])
    in_time = max(one.relative for found in every.values() for one in found["in time"])
    return [
        f"exact: errors of the virtual functions, which are bilinear on squares. Orders are {slopes['unit']:.2f} "
        f"(unit) and {slopes['shear']:.2f} (2 mu) rather than 1, because the solution is not in H^2 at the clamped "
        "corners, where the boundary condition changes.",
        "projected: errors of Pi u. nodal: |I u_ref - u|_{a^h}, where I u_ref has the values of the reference at the "
        "nodes of the run, in the norm a^h of the run. consistent: the same without the part S_K of a^h. (In the norm "
        f"a^h with 2 mu S_K, the nodal errors of the runs with S_K to the letter are {of_ours}.)",
        f"in time: at most {in_time:.0e}, the distance to a run on the same mesh with the steps of the reference. The "
        "load is proportional and no slipping node sticks again. Backward Euler therefore makes no error here, and all "
        "errors are errors of the mesh.",
        f"printed: {' '.join(nearest_to_print(every, sizes))} No reading of the text that we tried gives the printed "
        "numbers, nor the rise of their order to 1.17.",
    ]


def nearest_to_print(every: dict[str, Errors], sizes: Sequence[int]) -> list[str]:
    """Return a sentence for each stabilisation: the measure nearest to the printed numbers."""
    known = [k for k, n in enumerate(sizes) if n in PRINTED_ERRORS]
    words = []
    for name, found in every.items():
        ratios = {kind: np.array([found[kind][k].relative / PRINTED_ERRORS[sizes[k]] for k in known]) for kind in KINDS}
        kind = min(ratios, key=lambda one: np.abs(np.log(ratios[one])).max())
        low, high = ratios[kind].min(), ratios[kind].max()
        words.append(f"{name}: the nearest measure is {kind}, {low:.2f} to {high:.2f} times the printed errors.")
    return words


def figure_3(every: dict[str, Errors], sizes: Sequence[int]):
    """Draw errors against h = k, one panel for each stabilisation."""
    figure = new_figure(10.0, 4.6)
    h = 1 / np.array(sizes)
    panels = figure.subplots(1, len(every), sharey=True)
    for ax, (stabilisation, found) in zip(panels, every.items(), strict=True):
        columns = {"printed": [PRINTED_ERRORS.get(n, np.nan) for n in sizes]}
        columns |= {kind: [one.relative for one in found[kind]] for kind in KINDS}
        for name, values in columns.items():
            label = "printed in the paper" if name == "printed" else f"ours, {name}"
            ax.loglog(h, values, MARKS[name] + "-", color=COLOURS[name], ms=9 if name == "printed" else 5, label=label)
        guide = 0.35 * columns["consistent"][-1] * h / h[-1]
        ax.loglog(h, guide, "--", color="0.5", lw=1)
        ax.annotate("order 1", (h[len(h) // 2], guide[len(h) // 2]), xytext=(6, -12), textcoords="offset points")
        ax.set(xlabel="$h = k$")
        ax.set_title(f"{stabilisation}: {STABILISATIONS[stabilisation]}", fontsize="medium")
        ax.set_xticks(h, [f"1/{n}" for n in sizes])
        ax.xaxis.minorticks_off()
        plain_logarithms(ax.yaxis)
        light_grid(ax)
    panels[0].set_ylabel("relative error in the energy norm at $t = 1$")
    panels[0].legend(frameon=False, fontsize="small")
    return figure


def nodes(counts: Sequence[int] = tuple(PRINTED_NODES), seeds: int = 5) -> list[tuple[int, int, int, int, int, float]]:
    """Return a row of six numbers for each number of elements.

    The numbers are: elements; the fewest and the most nodes of polygon meshes over the seeds; the nodes of a
    polygon mesh without collapsed edges; the nodes of a triangle mesh; the longest side of a polygon.
    """
    rows = []
    for count in counts:
        side = round(np.sqrt(count / 2))
        polygons = [vx.meshes.voronoi(cells=count, seed=seed) for seed in range(seeds)]
        whole = vx.meshes.voronoi(cells=count, shortest=0.0).n_nodes
        found = [mesh.n_nodes for mesh in polygons]
        rows.append(
            (count, min(found), max(found), whole, vx.meshes.triangles(side).n_nodes, max(map(longest, polygons)))
        )
    return rows


def longest(mesh: vx.PolygonMesh) -> float:
    """Return the length of the longest side of a cell."""
    after = np.concatenate([np.roll(cell, -1) for cell in mesh.cells])
    return float(np.linalg.norm(mesh.points[after] - mesh.points[mesh.vertices], axis=1).max())


def table_4(rows: Sequence[tuple[int, int, int, int, int, float]]) -> Table:
    """Return the numbers of Fig. 4 as a table."""
    table = Table(title="Fig. 4: nodes of meshes of the unit square with equally many elements")
    for name in (
        "elements",
        "polygons, printed",
        "ours",
        "none collapsed",
        "triangles, printed",
        "ours",
        "longest side",
    ):
        table.add_column(name, justify="right")
    for count, fewest, most, whole, triangles, side in rows:
        printed = [str(p) for p in PRINTED_NODES.get(count, ("-", "-"))]
        ours = f"{fewest}" if fewest == most else f"{fewest} - {most}"
        table.add_row(f"{count}", printed[0], ours, f"{whole}", printed[1], f"{triangles}", f"{side:.4f}")
    return table


NOTE_4 = (
    "n polygons have 2 n + 2 nodes if three meet at every inner node. Every collapsed short edge removes one node. The "
    "paper has 3, 2, 1 and 16 nodes fewer. Our numbers vary with the seeds. The triangles, n/2 squares cut in two, "
    "have the printed numbers of nodes."
)


def figure_4(rows: Sequence[tuple[int, int, int, int, int, float]]):
    """Draw the number of nodes against the number of elements."""
    figure = new_figure(6.0, 4.2)
    ax = figure.subplots()
    count = [row[0] for row in rows]
    printed = np.array([PRINTED_NODES.get(n, (np.nan, np.nan)) for n in count])
    ax.loglog(count, [row[2] for row in rows], "h-", color=COLOURS["exact"], label="polygons, ours")
    ax.loglog(count, [row[4] for row in rows], "^-", color=COLOURS["nodal"], label="triangles, ours")
    ax.loglog(count, printed, "k+", ms=11, label=["printed in the paper", None])
    for n, both in zip(count, printed, strict=True):
        for value in both[np.isfinite(both)]:
            ax.annotate(f"{value:.0f}", (n, value), xytext=(-7, 6), textcoords="offset points", ha="right", fontsize=8)
    ax.set(
        xlabel="elements", ylabel="nodes", xlim=(0.5 * count[0], 1.5 * count[-1]), ylim=(0.5 * count[0], 4 * count[-1])
    )
    ax.set_xticks(count, [f"{n}" for n in count])
    ax.xaxis.minorticks_off()
    plain_logarithms(ax.yaxis, (1.0,))
    light_grid(ax)
    ax.legend(frameon=False)
    return figure


def main(
    out: Path, sizes=SIZES, reference=REFERENCE, n=24, steps=64, counts=tuple(PRINTED_NODES), console=None
) -> None:
    """Write all pictures into a folder, and print all tables."""
    console, start = console or Console(width=120), time.perf_counter()
    out.mkdir(parents=True, exist_ok=True)
    figure_1().savefig(out / "paper_figure_1.png", dpi=DPI)
    for name in STABILISATIONS:
        picture, runs = figure_2(n, steps, name)
        picture.savefig(out / f"paper_figure_2_{name}.png", dpi=DPI)
        for family, run in runs.items():
            console.print(f"Fig. 2, {name}, {family}: {describe_run(run)}", highlight=False)
    every = {name: errors(sizes, reference, name) for name in STABILISATIONS}
    figure_3(every, sizes).savefig(out / "paper_figure_3.png", dpi=DPI)
    rows = nodes(counts)
    figure_4(rows).savefig(out / "paper_figure_4.png", dpi=DPI)
    for name, found in every.items():
        for title, table in table_1(found, sizes).items():
            words = f'Table 1, "{name}", {STABILISATIONS[name]}: {title}'
            console.print(f"{words}\n\n{table}\n", markup=False, highlight=False)
    for note in notes_on_table_1(every, sizes):
        console.print(f"  {note}", highlight=False)
    console.print(table_4(rows))
    console.print(f"  {NOTE_4}")
    console.print(f"Where we depart from the text:\n\n{deviations()}\n", markup=False, highlight=False, soft_wrap=True)
    console.print(f"pictures in {out}; {time.perf_counter() - start:.0f} s")


def describe_run(run: vx.History) -> str:
    """Return a line with the result of a run."""
    slip, slips = run.contact.slip[-1, :, 0], ~run.contact.sticking[-1]
    return (
        f"{run.mesh.n_cells} cells, {run.mesh.n_nodes} nodes; largest tangential displacement {slip.max():.6f} mm, "
        f"{int(slips.sum())} of {len(slip)} contact nodes slip; certified {run.trajectory.certificate.max():.0e}"
    )


def deviations() -> str:
    """Return the deviations of the package from the text of the paper as a table of Markdown."""
    rows = [("the paper", "the package, by default", "the option that follows the paper"), ("---",) * 3, *DEVIATIONS]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("results/paper"), help="folder for the pictures")
    parser.add_argument("--deviations", action="store_true", help="print the table of deviations alone")
    chosen = parser.parse_args()
    if chosen.deviations:
        print(deviations())
    else:
        main(chosen.out)
