r"""The cost of algebraic accuracy: requested, certified and true errors of every solver.

Every solver solves two steps of `feng_han_huang.py` with several requested accuracies. Contact node i has one friction
term. The term is *degenerate* if its friction lam_i is at the bound, |lam_i| = w_i, and the slip of the node is zero.
In the step *growing* the load grows from 3/4 to 1, and no term is degenerate. In the step *return* the load grows again
from 1/2 to 1 after an unloading, and nearly half of the terms are degenerate. The condensed program has one unknown per
contact node; the full program has all unknowns. The solvers also solve the chain of `spring_slider_chain.py`, which has
degenerate steps and a closed form.

Every solution u is compared with Newton's solution u*, which is certified to rounding. Let gap(u) be the duality gap,
and floor(u) the part of the gap that rounding may cause. With the stiffness K of all unknowns,

$$
|u - u^*|_K \le \sqrt{2 \, \text{gap}(u)} + \sqrt{2 \, \text{floor}(u)} +
\sqrt{2 \, \text{gap}(u^*)} + \sqrt{2 \, \text{floor}(u^*)}.
$$

All errors are relative to the largest |u*|_K up to the step. A row of the table that violates this bound is marked
WRONG, and the exit code of the command is 1. Seconds are the median processor time of a step, in one thread. The time
of set-up includes factorisation and condensation. The requested accuracies get stricter until a solver misses an
accuracy. A solver that misses an accuracy tries again, and its seconds include both attempts.

Results (n = 32; Clarabel 0.11, OSQP 1.1, SCS 3.3, HiGHS 1.16):

- Without degenerate terms the error of a conic solution is proportional to the gap, and the certified error to the root
  of the gap. So solutions are much more accurate than certified: Clarabel's error is 1.5e-13 where 6.5e-8 is certified.
  With degenerate terms Clarabel's errors are within a factor of two of the certified errors: the bound is sharp.
- Clarabel's least certified errors are 1.0e-9 (condensed) and 3.6e-8 (full) without degenerate terms, and 1.4e-8 and
  2.9e-8 with degenerate terms. For the accuracy 1e-7 Clarabel takes 20 iterations with degenerate terms, and 11
  without. On the chain Clarabel reaches 1e-6, and misses 1e-8 in 54 of 117 steps, with certified errors of up to
  7.0e-7. From all these answers one active-set step (polish=True) leads to the solution, certified to rounding.
- OSQP finds the active set by its own polishing, in all four programs and at every accuracy: errors are at most 2e-14.
  On the chain OSQP reaches its limit of 100,000 iterations in some steps. OSQP misses the accuracy 1e-6 in one step and
  1e-8 in five steps, with certified errors of up to 1.5e-6. polish=True corrects these steps to rounding.
- OSQP counts iterations in multiples of 25. The condensed program takes 100 to 700 iterations without degenerate terms,
  and 175 to 2,975 iterations with degenerate terms. The full program takes 175 to 425 iterations without degenerate
  terms, and 100 to 325 iterations with degenerate terms. The accuracy 1e-10 takes 1.2 to 2.5 times as long as 1e-2.
- Newton's method reaches rounding after finitely many iterations, so a higher accuracy costs nothing.
- In one of the two steps HiGHS 1.15 reports an answer with an error of 14 % as optimal; in the other step its answer is
  right. The certificate shows which answer is wrong. HiGHS 1.16 is right in both steps, certified to 3.8e-9 and to
  rounding.

    python problems/solver_accuracy.py [--n 32] [--repeats 5] [--table FILE.csv] [--picture FILE.png]
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
import time
from dataclasses import astuple, dataclass, fields, replace
from functools import partial
from pathlib import Path

# BLAS reads its number of threads when numpy is imported. Processor time would count all threads, so we allow one.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import feng_han_huang
import spring_slider_chain
import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure, plain_logarithms
from vemcvx.plots.style import MARKERS, SERIES
from vemcvx.scene import pose_scene
from vemcvx.solvers.conic import list_installed
from vemcvx.stepping import certify_in_full, initial_state, prepare, step

STEPS = {"growing": (0.0, 0.75, 1.0), "return": (0.0, 1.0, 0.5, 1.0)}
"""Loads at the instants, divided by the full load; the last step is measured."""
FORMS = {"condensed": True, "full": False}
ACCURACIES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10)
FLOOR = 1e-15
"""Requested accuracy of the reference: as high as possible."""
MOST_UNKNOWNS = {"HIGHS": 100}
"""HiGHS may exceed its time limit for more unknowns."""
OURS = {
    "Newton": vx.Newton,
    "Clarabel": vx.Clarabel,
    "Clarabel, polished": partial(vx.Clarabel, polish=True),
    "OSQP": vx.OSQP,
    "OSQP, polished": partial(vx.OSQP, polish=True),
}


@dataclass(frozen=True)
class Row:
    """One step, solved by one solver: the requested and the reached accuracies are relative energy errors."""

    step: str
    form: str
    unknowns: int
    degenerate: int
    solver: str
    asked: float
    certified: float
    floor: float
    reference: float
    """The certified error of u*, with its floor."""
    true: float
    setup: float
    seconds: float
    iterations: int
    said: str

    @property
    def kept(self):
        """True if the true error obeys the bound."""
        return self.true <= self.certified + self.floor + self.reference

    @property
    def missed(self):
        """True if the certified error exceeds the requested accuracy."""
        return self.certified > self.asked


@dataclass(frozen=True)
class Reference:
    """Newton's states at all instants; the last state has all unknowns."""

    name: str
    form: str
    system: vx.System
    states: tuple

    @property
    def answer(self):
        return self.states[-1]

    @property
    def degenerate(self):
        """The number of terms that are at their bounds and do not slip."""
        size, slip = (np.linalg.norm(v, axis=1) for v in (self.answer.lam, self.answer.slip))
        return int(((size >= self.answer.weights * (1 - 1e-9)) & (slip <= 1e-9 * np.abs(self.answer.y).max())).sum())


def solvers():
    """Return a function for each name of a solver; the function takes an accuracy and returns the solver."""
    others = [name for name in list_installed() if name not in ("CLARABEL", "OSQP")]
    return OURS | {name: partial(vx.ThroughCvxpy, name) for name in others}


def reference(name, form, n):
    """Return the step, posed on squares, with its solution by Newton's method."""
    system = pose_scene(feng_han_huang.scene(), feng_han_huang.mesh(n)).system
    full_load, levels = system.force(1.0), STEPS[name]
    system = replace(system, load=lambda t: levels[round(t)] * full_load)
    run = prepare(system, vx.Newton(accuracy=FLOOR), check=False, condense=FORMS[form])
    states = [initial_state(run, np.arange(len(levels), dtype=float), None)]
    for k in range(1, len(levels)):
        states.append(step(run, states[-1], k, float(k)))
    return Reference(name, form, system, (*states[:-1], certify_in_full(run, states[-1])))


def measure(exact, name, solver, repeats):
    """Return the row of one solver at one accuracy, or None if the solver does not accept the program."""
    last, states = len(exact.states) - 1, exact.states
    start = time.process_time()
    try:
        run = prepare(exact.system, solver, check=False, condense=FORMS[exact.form])
    except vx.NotAccepted:
        return None
    setup, earlier, later = time.process_time() - start, [], []
    for _ in range(repeats):
        earlier.append(time_call(step, run, states[-3], last - 1, last - 1.0)[0])
        seconds, found = time_call(step, run, states[-2], last, float(last))
        later.append(seconds)
    found = certify_in_full(run, found)
    apart = energy_norm(exact.system.K, found.full - exact.answer.full)
    errors = found.certificate.error, found.certificate.error_floor, error_bound(exact.answer), apart
    return Row(
        *(exact.name, exact.form, len(found.y), exact.degenerate, name, solver.accuracy),
        *(float(error / exact.answer.scale) for error in errors),
        *(setup + earlier[0] - float(np.median(earlier[1:] or earlier)), float(np.median(later))),
        *(found.iterations, found.status),
    )


def time_call(action, *given):
    start = time.process_time()
    made = action(*given)
    return time.process_time() - start, made


def error_bound(state):
    return state.certificate.error + state.certificate.error_floor


def energy_norm(K, u):
    return np.sqrt(max(u @ (K @ u), 0.0))


def sweep(n, accuracies=ACCURACIES, repeats=5, names=None):
    """Return all rows; the requested accuracy of each solver gets stricter until the solver misses it."""
    rows, made = [], solvers()
    for name in STEPS:
        for form in FORMS:
            exact = reference(name, form, n)
            for solver in names or made:
                if len(exact.answer.y) > MOST_UNKNOWNS.get(solver, np.inf):
                    continue
                for accuracy in accuracies:
                    row = measure(exact, solver, made[solver](accuracy=accuracy), repeats)
                    rows += [row] if row else []
                    if row is None or row.missed:
                        break
    return rows


def format_rows(rows):
    """Return the table as text."""
    lines, before = [], None
    for row in rows:
        if (row.step, row.form) != before:
            before = row.step, row.form
            size = f"{row.unknowns} unknowns, {row.degenerate} degenerate terms"
            lines += ["", f"{row.step}, {row.form}: {size}, u* certified to {row.reference:.0e}"]
            lines.append("solver              asked  certified  floor     true   seconds   set-up  iterations  status")
        said = row.said + ("; missed" if row.missed else "") + ("" if row.kept else "  WRONG: true error above bound")
        lines.append(
            f"{row.solver:<19} {row.asked:.0e}    {row.certified:.1e}  {row.floor:.0e}  {row.true:.1e}  "
            f"{row.seconds:8.5f} {row.setup:8.4f}  {row.iterations:10d}  {said}"
        )
    return "\n".join(lines[1:])


def write_table(rows, path):
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow([field.name for field in fields(Row)])
        table.writerows(astuple(row) for row in rows)


def run_loops(asked=(1e-6, 1e-8)):
    """Return the table for the chain of sliders."""
    force = spring_slider_chain.course(spring_slider_chain.TURNS, first=1.0)
    system, (exact, _) = spring_slider_chain.chain(force), spring_slider_chain.chain_exactly(force)
    lines = ["chain of sliders      asked  certified  all steps  true     missed  most iterations"]
    for name, make in OURS.items():
        for accuracy in asked:
            run = vx.march(system, np.arange(len(force)), solver=make(accuracy=accuracy), check=False)
            true = max(energy_norm(system.K, apart) for apart in run.state - exact) / run.norm.max()
            missed = f"{(run.certificate > accuracy).sum():3} of {len(force) - 1}"
            certified = f"{run.certificate.max():.1e}    {run.certificate_total[-1]:.1e}    {true:.1e}"
            lines.append(f"{name:<21} {accuracy:.0e}  {certified}  {missed}  {run.iterations.max():8}")
    return "\n".join(lines)


def draw(rows, path):
    """Draw certified errors (above) and true errors (below) against seconds, with a column for each program."""
    names = list(dict.fromkeys(row.solver for row in rows))
    figure = new_figure(12.0, 7.2)
    columns = [(name, form) for name in STEPS for form in FORMS]
    panels = figure.subplots(2, len(columns), sharex="col", sharey=True)
    for column, (name, form) in zip(panels.T, columns, strict=True):
        here = [row for row in rows if (row.step, row.form) == (name, form)]
        for k, solver in enumerate(names):
            draw_series(column, [row for row in here if row.solver == solver], SERIES[k], MARKERS[k])
        count = max((row.degenerate for row in here), default=0)
        column[0].set_title(f"{name}, {form}:\n{count} degenerate terms", fontsize="medium")
        column[1].set_xlabel("seconds a step, after set-up")
        for axes in column:
            axes.set(xscale="log", yscale="log")
            plain_logarithms(axes.xaxis)
            light_grid(axes)
    for axes, what in zip(panels[:, 0], ("certified", "true"), strict=True):
        axes.set_ylabel(f"{what} relative error, energy norm")
    keys = [panels[0, 0].plot([], [], MARKERS[k] + "-", color=SERIES[k], label=name)[0] for k, name in enumerate(names)]
    keys += panels[0, 0].plot([], [], "kx", markersize=9, label="missed the requested accuracy")
    figure.legend(handles=keys, loc="outside lower center", ncols=len(keys), fontsize="small", frameon=False)
    figure.savefig(path, dpi=120)


def draw_series(column, rows, colour, marker):
    """Draw the errors of one solver on one program at all requested accuracies."""
    seconds = [row.seconds for row in rows]
    for axes, name in zip(column, ("certified", "true"), strict=True):
        axes.plot(seconds, [getattr(row, name) for row in rows], marker + "-", color=colour, markersize=6, linewidth=1)
    missed = [row for row in rows if row.missed]
    column[0].plot([row.seconds for row in missed], [row.certified for row in missed], "kx", markersize=9, zorder=9)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=32, help="number of cells per side")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--table", type=Path, help="where to write the rows (CSV)")
    parser.add_argument("--picture", type=Path, help="where to draw the errors (PNG)")
    chosen = parser.parse_args()
    rows = sweep(chosen.n, repeats=chosen.repeats)
    print(format_rows(rows), run_loops(), sep="\n\n")
    if chosen.table:
        write_table(rows, chosen.table)
    if chosen.picture:
        draw(rows, chosen.picture)
    wrong = [row for row in rows if not row.kept]
    print(f"\n{len(rows)} answers, {len(wrong)} farther from u* than their certificates allow")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
