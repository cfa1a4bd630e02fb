"""Adaptive meshes compared with uniform squares at the same true error: times and numbers of unknowns.

    python problems/adaptive_meshes.py [--small] [--picture FILE]

The two scenes are the paper's scene (`feng_han_huang.py`) and an L-shaped bracket. Both have singular stresses. The
true error is the distance from a reference run in the energy norm. The reference mesh is the finest adaptive mesh,
refined until it is nowhere coarser than the finest uniform mesh. Then the cells with the largest estimated errors are
refined twice.

An adaptive run starts from a coarse mesh and one time step. The measured seconds include all refinements. The table
compares the two finest uniform runs with the smallest adaptive runs that are at least as accurate. The column "limit"
has the number of cells of the best mesh, divided by the number of cells of the uniform mesh. The best mesh has no
stretched cells, and all of its cells have the same error. Suppose that a cell of the area |K| has the error
e_K = sqrt(c) |K|, where c depends on the place. The sum S of all e_K is then the integral of sqrt(c) on every mesh. The
best mesh of n cells has the errors e_K = S / n and the total error E = S / sqrt(n), so that n = S^2 / E^2.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).parent))

import feng_han_huang as paper
import l_shaped_bracket as bracket
import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure, plain_logarithms
from vemcvx.estimate.adapt import cells_to_refine
from vemcvx.plots.style import COMPUTED, SECOND

STEPS = 32
TRIES = 7


@dataclass(frozen=True)
class Study:
    """A scene, and the function `mesh(n)`, which returns a mesh with n squares per unit of length.

    The first adaptive mesh is `mesh(coarse)`; the uniform meshes are `mesh(n)` for n in `sizes`.
    """

    name: str
    scene: vx.Scene
    mesh: object
    coarse: int
    sizes: tuple[int, ...]


@dataclass(frozen=True)
class Run:
    """One simulation: its history, number of unknowns, total seconds, estimated and true relative error."""

    history: vx.History
    unknowns: int
    seconds: float
    estimate: float
    true: vx.measures.Measured | None = None

    @property
    def error(self) -> float:
        return self.true.relative


def run_uniform(study, n):
    start = time.perf_counter()
    history = vx.simulate(study.scene, study.mesh(n), np.linspace(0.0, 1.0, STEPS + 1), store="last")
    seconds = time.perf_counter() - start
    return Run(history, history.trajectory.state.shape[1], seconds, float(vx.error_budget(history, [STEPS]).space[0]))


def run_adaptive(study, target):
    start = time.perf_counter()
    found = vx.adapt(study.scene, study.mesh(study.coarse), [0.0, 1.0], target)
    return Run(found.history, found.passes[-1].unknowns, time.perf_counter() - start, found.passes[-1].space), found


def reference(study, run, n):
    """Return the reference run, whose mesh refines the mesh of `run`."""
    mesh, h = run.history.mesh, study.mesh(n).h
    while (coarser := mesh.diameters > 1.01 * h).any():
        mesh = mesh.refine(coarser)
    for _ in range(2):
        history = vx.simulate(study.scene, mesh, [0.0, 0.5, 1.0], store="last")
        mesh = mesh.refine(cells_to_refine(vx.error_budget(history, [2]).cells ** 2, 0.0, 0.7))
    return vx.simulate(study.scene, mesh, [0.0, 0.5, 1.0], store="last")


def measure_error(run, truth):
    return Run(run.history, run.unknowns, run.seconds, run.estimate, vx.measures.energy_distance(run.history, truth))


def match_error(study, beside, truth):
    """Return the smallest adaptive run at least as accurate as `beside`, and its result of `vx.adapt`."""
    low, high, kept = 0.7 * beside.estimate, 2.5 * beside.estimate, None
    for _ in range(TRIES):
        target = float(np.sqrt(low * high))
        run, found = run_adaptive(study, target)
        run = measure_error(run, truth)
        if run.error > beside.error:
            high = target
            continue
        low = target
        if kept is None or run.unknowns < kept[0].unknowns:
            kept = run, found
    return kept


def optimal_fraction(beside, run):
    """Return the number of cells of the best mesh, divided by the number of cells of `beside`."""
    return float(run.true.cells.sum() ** 2 / beside.true.absolute**2 / beside.history.mesh.n_cells)


def fit_slope(runs):
    return float(np.polyfit(np.log([r.unknowns for r in runs]), np.log([r.error for r in runs]), 1)[0])


def run_study(study):
    """Return uniform runs, triples (uniform run, adaptive run, result), adaptive runs, and the reference run."""
    equal = [run_uniform(study, n) for n in study.sizes]
    finest, _ = run_adaptive(study, 1.2 * equal[-1].estimate)
    truth = reference(study, finest, study.sizes[-1])
    equal = [measure_error(run, truth) for run in equal]
    pairs = [(run, *match_error(study, run, truth)) for run in equal[-2:]]
    coarser = [measure_error(run_adaptive(study, 1.4 * f * equal[-1].estimate)[0], truth) for f in (8.0, 4.0, 2.0)]
    return equal, pairs, [*coarser, *(run for _, run, _ in pairs)], truth


def picture(results):
    figure = new_figure(11.0, 7.4)
    grid = figure.subplots(2, len(results))
    for column, (case, (equal, pairs, adapted, _)) in enumerate(results):
        ax = grid[0, column]
        for runs, colour, mark, name in ((equal, COMPUTED, "s-", "uniform"), (adapted, SECOND, "o-", "adaptive")):
            label = f"{name}, $N^{{{fit_slope(runs):.2f}}}$"
            ax.loglog([r.unknowns for r in runs], [100 * r.error for r in runs], mark, color=colour, label=label)
        ax.set(title=case.name, xlabel="unknowns", ylabel="true energy error [%]")
        plain_logarithms(ax.yaxis)
        light_grid(ax)
        ax.legend(frameon=False)
        _, _, found = pairs[0]
        below = grid[1, column]
        mesh = found.history.mesh
        mesh.plot(ax=below, linewidth=0.15, edgecolor="0.2", facecolor="none")
        below.set(title=f"{mesh.n_cells} cells, {100 * adapted[-2].error:.2f} % error", xticks=[], yticks=[])
        below.set_frame_on(False)
    return figure


def rows(results):
    table = Table(
        *("scene", "uniform n", "unknowns", "error", "seconds"),
        *("adaptive unknowns", "error", "seconds", "adaptive / uniform", "limit"),
    )
    for case, (_, pairs, _, _) in results:
        for n, (one, other, _) in zip(case.sizes[-2:], pairs, strict=True):
            share, seconds = other.unknowns / one.unknowns, other.seconds / one.seconds
            table.add_row(
                *(case.name, str(n), str(one.unknowns), f"{one.error:.3%}", f"{one.seconds:.2f}"),
                *(str(other.unknowns), f"{other.error:.3%}", f"{other.seconds:.2f} = {seconds:.2f} x"),
                *(f"{share:.2f} x", f"{optimal_fraction(one, other):.2f} x"),
            )
    return table


def run_studies(sizes):
    """Return the studies of both scenes, with uniform meshes of `sizes` squares per unit of length."""
    cases = (
        Study("the paper's scene", paper.scene(), vx.meshes.squares, 8, sizes),
        Study("L-shaped bracket", bracket.scene(), vx.meshes.l_shape, 4, sizes),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vx.SceneWarning)
        return [(case, run_study(case)) for case in cases]


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--small", action="store_true", help="coarser meshes: a run of half a minute")
    parser.add_argument("--picture", type=Path, help="file for the picture (PNG)")
    given = parser.parse_args(arguments)
    results = run_studies((8, 16, 32, 64) if given.small else (32, 64, 128, 256))
    console = Console(width=150)
    console.print(rows(results))
    for case, (equal, _, adapted, truth) in results:
        console.print(
            f"{case.name}: error like unknowns^{fit_slope(equal):.2f} uniform, ^{fit_slope(adapted):.2f} adaptive; "
            f"reference of {truth.mesh.n_cells} cells, estimated error {vx.error_budget(truth, [2]).space[0]:.2%}"
        )
        parts = adapted[-1].history.seconds
        seconds = f"prepare {parts['prepare']:.2f} s, solve {parts['solve']:.2f} s"
        console.print(f"    last pass of the finest adaptive run: {seconds}")
    if given.picture is not None:
        picture(results).savefig(given.picture, dpi=110)
    return results


if __name__ == "__main__":
    main()
