"""`vemcvx benchmark`: compare the times in which solvers reach the same true error.

A trial is one run of a solver with one tolerance. The true error of an answer d is |d - d*|_K / |d*|_K, where d* is the
certified optimum and |.|_K the energy norm. The time to an error E is the time of the *cheapest* trial with a true
error of at most E. Mean times are shifted geometric means exp(mean log(t + s)) - s with s = 0.01 seconds. Performance
profiles follow Dolan and Moré (2002).
"""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import astuple, dataclass, fields, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from vemcvx.base.canvas import as_png, light_grid, new_figure, plain_logarithms
from vemcvx.base.errors import NotAccepted, ProblemError, SolverFailed, VemcvxError, quietly
from vemcvx.base.owned_files import Owned
from vemcvx.base.table import Table
from vemcvx.base.version import __version__
from vemcvx.cli.collection.writing import INFEASIBLE, MANIFEST, UNBOUNDED
from vemcvx.cli.doctor import version_of
from vemcvx.cli.solver_names import make_solver
from vemcvx.cli.terminal import FRACTIONS, fraction, parse_list, progress_bar, say
from vemcvx.cost.workers import use_one_thread
from vemcvx.exchange import sequence_from_npz
from vemcvx.plots.style import SERIES
from vemcvx.program import Answer, SolvedProgram, StepProgram
from vemcvx.solvers import Prepared, Solver, ThroughCvxpy
from vemcvx.solvers.solver import ScaledSolver, name_failures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ERRORS = 1e-3, 1e-6, 1e-9  # relative errors in the energy norm
BEGUN, ANSWERED, FAILED, LATE, REFUSED = "begun", "answered", "failed", "out of time", "refused"
"""Outcomes of a trial."""
PLANE, DISCS, NO_OPTIMUM, SEQUENCE = "plane", "discs", "no optimum", "sequence"
KINDS = {
    PLANE: "Absolute values and bounds",
    DISCS: "Discs: second-order cones",
    NO_OPTIMUM: "Infeasible or unbounded",
    SEQUENCE: "Sequences of steps, each with a warm start from the previous answer",
}
"""Kind of instances -> title in tables."""
LIBRARIES: Mapping[str, tuple[tuple[str, ...], Mapping[str, int], float]] = {
    "CLARABEL": (("tol_gap_abs", "tol_gap_rel", "tol_feas"), {"max_iter": 10_000}, 0.0),
    "CVXOPT": (("abstol", "reltol", "feastol"), {"max_iters": 10_000}, 0.0),
    "DAQP": (("primal_tol", "dual_tol"), {}, 0.0),
    "ECOS": (("abstol", "reltol", "feastol"), {"max_iters": 10_000}, 0.0),
    "HIGHS": (("primal_feasibility_tolerance", "dual_feasibility_tolerance"), {}, 1e-10),
    "OSQP": (("eps_abs", "eps_rel"), {"max_iter": 10**9}, 0.0),
    "PIQP": (("eps_abs", "eps_rel"), {"max_iter": 10_000}, 0.0),
    "PROXQP": (("eps_abs", "eps_rel"), {"max_iter": 10**9}, 0.0),
    "QOCO": (("abstol", "reltol"), {"max_iters": 10_000}, 0.0),
    "SCS": (("eps_abs", "eps_rel"), {"max_iters": 10**9}, 0.0),
}
"""Solver in cvxpy -> options for tolerances, options for the iteration limit, and smallest accepted tolerance."""
PACKAGES = {"HIGHS": "highspy", "PROXQP": "proxsuite"}  # name in cvxpy -> name of the package, if different
REPEATS, LONG_ENOUGH = 5, 0.1  # largest number of timed calls, and seconds after which no further call begins
BATCH = 10  # number of instances per process
MEAN_SHIFT = 0.01  # shift of the geometric mean, seconds
TABLE, WORDS, PROFILES = "trials.csv", "benchmark.txt", "profiles.png"


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """The command `vemcvx benchmark`."""

    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that `vemcvx collection` wrote.")]
    solvers: Annotated[str, typer.Option(metavar="A,B,...", help="Solvers.")]
    time_limit: Annotated[float, typer.Option(min=0.01, metavar="SECONDS", help="Time limit of one trial.")] = 60.0
    tolerances: Annotated[
        str, typer.Option(metavar="X,X,...", help="Tolerances of the solvers.", show_default="1e-1,1e-2,...,1e-15")
    ] = ",".join(f"1e-{k}" for k in range(1, 16))
    only: Annotated[str | None, typer.Option(metavar="WORD,...", help="Only instances named by these words.")] = None
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Output. (default: DIR/benchmark)")] = None

    def __call__(self) -> None:
        """Compare solvers on a collection at equal true accuracy: sweep tolerances, write a table and a picture."""
        instances = read_instances(self.folder, self.only)
        tolerances = parse_list("--tolerances", self.tolerances, fraction, FRACTIONS)
        names = parse_list("--solvers", self.solvers, str, "names such as clarabel,scs")
        out = self.out or self.folder / "benchmark"
        labels, entries = {name_solver(typed): typed for typed in names}, dict[str, dict[str, list[Trial]]]()
        with Owned(out) as files, progress_bar("benchmark") as show:
            for name in (TABLE, WORDS, PROFILES):
                files.take(name)
            for label, typed in labels.items():
                own = entries[label] = {}
                for trial in run_trials(typed, self.folder, instances, tolerances, self.time_limit):
                    own.setdefault(trial.instance, []).append(trial)
                    show(label, len(own), len(instances))
            heads = ("solver", *(field.name for field in fields(Trial)))
            tried = [(label, *astuple(one)) for label, own in entries.items() for some in own.values() for one in some]
            files.write(TABLE, Table(heads, tried).csv())
            text = in_words(entries, instances, self.time_limit)
            files.write(WORDS, f"{text}\n")
            try:
                files.write(PROFILES, as_png(profiles(entries, instances), 150))
            except VemcvxError as error:
                text = f"{text}\n\nNo picture: {error}."
        say(f"{text}\n\n{out} has every trial ({TABLE}), the tables ({WORDS}) and the picture ({PROFILES})")


Row = Mapping[str, Any]  # entry of an instance in the manifest


def read_instances(folder: Path, only: str | None = None) -> Sequence[Row]:
    """Return the instances of a collection, selected by the words in `only`."""
    path = folder / MANIFEST
    try:
        rows: Sequence[Row] = json.loads(path.read_text(encoding="utf-8"))["instances"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        how = f"write one by vemcvx collection --out {folder}"
        raise ProblemError(f"{folder}: has no {MANIFEST} of a collection ({error}); {how}.") from error
    if only is None:
        return rows
    words, wanted = parse_list("--only", only, str, "words such as core,discs,degenerate"), list[Row]()
    for row in rows:
        if any(w == row["grade"] or w in row["name"] or (w == "core" and row.get("core")) for w in words):
            wanted.append(row)
    if not wanted:
        grades = ", ".join(sorted({row["grade"] for row in rows}))
        raise ProblemError(f"--only: no grade or name has {only!r}; the grades are {grades}; core is the core set.")
    return wanted


def kind_of(row: Row) -> str:
    """Return the kind of an instance."""
    if "optimum" not in row:
        return NO_OPTIMUM
    return SEQUENCE if row["steps"] > 1 else DISCS if row["block"] > 1 else PLANE


@dataclass(frozen=True)
class Trial:
    """The result of a solver with one tolerance on one instance."""

    instance: str
    tolerance: float | None = None  # None if the solver has no tolerances
    outcome: str = BEGUN
    seconds: float | None = None
    true: float | None = None
    certified: float | None = None
    iterations: int | None = None
    message: str = ""

    @property
    def is_enough(self) -> bool:
        """True if the answer is so accurate that no tighter tolerance is tried."""
        if self.true is None or self.certified is None:
            return False
        return self.true <= min(ERRORS) and self.certified <= ERRORS[1]


Ladder = Sequence[float | None]  # tolerances from loose to tight, or a single None
Entries = Mapping[str, Mapping[str, Sequence[Trial]]]
"""Label of a solver -> name of an instance -> trials."""


def run_trials(
    typed: str, folder: Path, instances: Sequence[Row], tolerances: Sequence[float], limit: float
) -> Iterator[Trial]:
    """Yield the trials of a solver, run in processes with a time limit."""
    spawn, names = get_context("spawn"), [one["name"] for one in instances]
    while names:
        here, there = spawn.Pipe(duplex=False)
        given = there, typed, folder, names[:BATCH], tolerances, limit
        process = spawn.Process(target=try_all, args=given, daemon=True)
        process.start()
        there.close()
        trial, seconds, outcome = None, None, LATE
        try:
            while here.poll(seconds):
                trial, seconds = here.recv()
                if trial.outcome != BEGUN:
                    yield trial
        except EOFError:
            process.join()
            outcome = FAILED
        finally:
            process.kill()
            process.join()
        words = f"its process ended with exit code {process.exitcode}"
        if trial is None:
            raise ProblemError(f"benchmark: {typed}: {words} before anything was tried.")
        if trial.outcome == BEGUN:
            yield replace(trial, outcome=outcome, message=words if outcome == FAILED else "")
        names = names[names.index(trial.instance) + 1 :]


def try_all(
    pipe: Connection, typed: str, folder: Path, names: Sequence[str], tolerances: Sequence[float], limit: float
) -> None:
    """Send pairs (trial, limit) through the pipe. The limit is the longest time to the next pair."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Some libraries always print.
    use_one_thread()
    solver = make_solver(typed, None, "--solvers")
    ladder = choose_ladder(solver, tolerances)
    for name in names:
        programs = sequence_from_npz(folder / f"{name}.npz")
        status = json.loads((folder / f"{name}.json").read_text(encoding="utf-8")).get("status", "")
        trial = Trial(name, ladder[0])
        try:
            pipe.send((trial, None))
            calls = make_calls(solver, programs)
            for tolerance in ladder:
                trial = replace(trial, tolerance=tolerance)
                pipe.send((trial, limit))
                ended = replace(trial, outcome=ANSWERED, **measure(calls, programs, tolerance, status))
                pipe.send((ended, None))
                if ended.is_enough:
                    break
        except VemcvxError as error:
            outcome = REFUSED if isinstance(error, NotAccepted) else FAILED
            pipe.send((replace(trial, outcome=outcome, message=str(error)), None))


Memory = dict[str, Any]
"""Data for the warm start of the next step."""
Call = Callable[[float | None, Memory], tuple[float, Answer | None, str]]
"""Function (tolerance, memory) -> (seconds, answer or None, status)."""


def name_solver(typed: str) -> str:
    """Return the name of a solver, followed by a version or a file name."""
    solver, name = make_solver(typed, None, "--solvers"), typed.lower()
    if ":" in typed:
        return f"{solver.name} {Path(typed.rpartition(':')[0]).name}"
    if isinstance(solver, ThroughCvxpy):
        return f"{name} {version_of(PACKAGES.get(solver.solver, name)) or 'unknown'}"
    return f"{name} {__version__}"


def choose_ladder(solver: Solver, tolerances: Sequence[float]) -> Ladder:
    """Return the tolerances for a solver, from loose to tight."""
    name = getattr(solver, "solver", None)
    if name is not None and name not in LIBRARIES:
        return (None,)
    least = LIBRARIES[name][2] if name else 0.0
    return tuple(sorted({max(one, least) for one in tolerances}, reverse=True))


def make_calls(solver: Solver, programs: Sequence[StepProgram]) -> list[Call]:
    """Return one `Call` per program, or raise NotAccepted."""
    operators = programs[0].operators
    if missing := operators.features - solver.accepts:
        raise NotAccepted(f"solver {solver.name}: accepts no {' and no '.join(sorted(missing))}.")
    if operators.kernel is not None and not solver.semidefinite:
        raise NotAccepted(f"solver {solver.name}: accepts no semidefinite K.")
    if isinstance(solver, ThroughCvxpy):
        scaling = ScaledSolver(solver, operators)
        alpha = max(scaling.length(program) for program in programs)
        return [_call_cvxpy(solver, scaling, alpha, program) for program in programs]
    with name_failures(solver.name):
        prepared = solver.prepare(operators) if solver.any_units else ScaledSolver(solver, operators)
    return [_call_own(prepared, program, _unit(programs)) for program in programs]


def _call_cvxpy(solver: ThroughCvxpy, scaling: ScaledSolver, alpha: float, program: StepProgram) -> Call:
    posed = scaling.scale(program, alpha).to_cvxpy()
    data, chain, inverse = posed.problem.get_problem_data(solver.solver, solver_opts={})
    tolerances, unlimited, _ = LIBRARIES.get(solver.solver, ((), {}, 0.0))

    def call(tolerance: float | None, memory: Memory) -> tuple[float, Answer | None, str]:
        # Some interfaces of cvxpy change the dictionaries that they receive.
        options = {**unlimited, **dict.fromkeys(tolerances, tolerance), **solver.options}
        start = time.process_time()
        raw = chain.solver.solve_via_data(dict(data), True, False, options, memory)
        seconds = time.process_time() - start
        posed.problem.unpack_results(raw, chain, inverse)
        d, stats, status = posed.d.value, posed.problem.solver_stats, str(posed.problem.status)
        if d is None or posed.lam is None or posed.p is None:
            return seconds, None, status
        count = 0 if stats is None or stats.num_iters is None else int(stats.num_iters)
        return seconds, scaling.restore(Answer(d, posed.lam, count, p=posed.p), alpha), status

    return call


def _call_own(prepared: Prepared, program: StepProgram, unit: float) -> Call:
    zero = {"lam": np.zeros((len(program.w), program.operators.block)), "p": np.zeros_like(program.e)}

    def call(tolerance: float | None, memory: Memory) -> tuple[float, Answer | None, str]:
        target, begin = 0.5 * ((tolerance or 0.0) * unit) ** 2, zero | memory
        start = time.process_time()
        answer = prepared.solve(program, target, begin["lam"], begin["p"])
        seconds = time.process_time() - start
        memory |= {"lam": answer.lam, "p": answer.p}
        return seconds, answer, answer.status

    return call


def _unit(programs: Sequence[StepProgram]) -> float:
    """Return the largest energy norm of the known optima, or 1 if all norms are zero."""
    return max((program.norm for program in programs if isinstance(program, SolvedProgram)), default=0.0) or 1.0


def measure(
    calls: Sequence[Call], programs: Sequence[StepProgram], tolerance: float | None, status: str = ""
) -> dict[str, Any]:
    """Return the measured fields of a trial."""
    memory: Memory = {}
    unit, taken, iterations, errors, reported = _unit(programs), 0.0, 0, [], ""
    with name_failures("of this trial"), quietly():
        for call, program in zip(calls, programs, strict=True):
            begun = time.perf_counter()
            seconds, answer, reported = call(tolerance, memory)
            for _ in range(REPEATS - 1 if len(programs) == 1 else 0):
                if time.perf_counter() - begun > LONG_ENOUGH:
                    break
                seconds = min(seconds, call(tolerance, {})[0])
            taken += seconds
            iterations += 0 if answer is None else answer.iterations
            stated = reported.lower().removesuffix("_inaccurate")
            # A wrong status counts as an infinite error.
            if status or stated in (INFEASIBLE, UNBOUNDED):
                errors.append((0.0, 0.0) if stated == status else (np.inf, np.inf))
            elif answer is None or not np.isfinite(answer.d).all():
                raise SolverFailed(f"its status is {reported!r}, without an answer of finite numbers.")
            else:
                errors.append(_errors(program, answer, unit))
    true, certified = map(max, zip(*errors, strict=True))
    found = {"seconds": taken, "true": true, "certified": certified}
    return {**found, "iterations": iterations or None, "message": reported}


def _errors(program: StepProgram, answer: Answer, unit: float) -> tuple[float, float]:
    assert isinstance(program, SolvedProgram)
    certificate = program.certify(answer.d, answer.lam, answer.p)
    true = program.operators.energy_norm(answer.d - program.answer.d)
    return true / unit, float(certificate.error + certificate.error_floor) / unit


def seconds_to(trials: Iterable[Trial], error: float, measure: str = "true") -> float:
    """Return the seconds of the cheapest trial that reaches the error, or infinity."""
    known = [(one.seconds, getattr(one, measure)) for one in trials if one.seconds is not None]
    return min((seconds for seconds, reached in known if reached is not None and reached <= error), default=np.inf)


def is_accepted(own: Mapping[str, Sequence[Trial]], name: str) -> bool:
    """Return True if a solver was tried on an instance and did not refuse."""
    return name in own and all(one.outcome != REFUSED for one in own[name])


def outcome_at(trials: Sequence[Trial], error: float) -> str:
    """Return "reached", "missed", FAILED or LATE."""
    if np.isfinite(seconds_to(trials, error)):
        return "reached"
    outcomes = [one.outcome for one in trials]
    return next((one for one in (LATE, FAILED) if one in outcomes), "missed")


def select_common(entries: Entries, instances: Sequence[Row], kind: str, error: float) -> tuple[Entries, list[str]]:
    """Return the solvers that accept instances of a kind, and the names of instances that all of them accept."""
    # The certified error of the optimum must be at most a tenth of `error`.
    names = [one["name"] for one in instances if kind_of(one) == kind and one.get("certified", 0.0) <= 0.1 * error]
    some = {label: own for label, own in entries.items() if any(is_accepted(own, name) for name in names)}
    return some, [name for name in names if some and all(is_accepted(own, name) for own in some.values())]


def geometric_mean(seconds: Sequence[float], limit: float) -> float:
    """Return the shifted geometric mean of seconds, capped at the limit, or NaN."""
    if not seconds:
        return float("nan")
    capped = np.minimum(np.asarray(seconds, dtype=float), limit)
    return float(np.exp(np.log(capped + MEAN_SHIFT).mean()) - MEAN_SHIFT)


def in_words(entries: Entries, instances: Sequence[Row], limit: float) -> str:
    """Return the tables as text."""
    text = ""
    for kind, title in KINDS.items():
        if select_common(entries, instances, kind, max(ERRORS))[0]:
            count = sum(kind_of(one) == kind for one in instances)
            text += f"{title}: {count} instances\n{score_table(entries, instances, kind, limit).text()}\n\n"
    return text + (
        'A column "to E" counts the instances solved to the error E. The number after the slash counts accepted '
        'instances with an optimum certified to E / 10. A column "s to E" has the shifted geometric mean of '
        "processor times with the cheapest tolerance, over the instances that all solvers accept; an unsolved instance "
        f'counts as {limit:g} s. Column "sure" counts instances with a certified error of at most {ERRORS[1]:g}. '
        f'Columns "miss", "fail" and "late" count instances not solved to {ERRORS[1]:g}: larger error, no answer, late.'
    )


def score_table(entries: Entries, instances: Sequence[Row], kind: str, limit: float) -> Table:
    """Return a table with one row per solver, sorted by the time to 1e-6."""
    rows, errors = [], [f"1e{round(np.log10(error))}" for error in ERRORS]
    for label, own in select_common(entries, instances, kind, max(ERRORS))[0].items():
        counts, means = [], []
        for error in ERRORS:
            mine, common = (select_common(some, instances, kind, error)[1] for some in ({label: own}, entries))
            outcomes = Counter(outcome_at(own[name], error) for name in mine)
            counts.append((f"{outcomes['reached']}/{len(mine)}", outcomes, mine))
            means.append(geometric_mean([seconds_to(own[name], error) for name in common], limit))
        _, outcomes, mine = counts[1]
        sure = sum(np.isfinite(seconds_to(own[name], ERRORS[1], "certified")) for name in mine)
        ends = [str(count) for count in (sure, *(outcomes[one] for one in ("missed", FAILED, LATE)))]
        seconds = ["-" if np.isnan(m) else f"{m:.4f}"[1:] if m < 1 else f"{m:.3g}" for m in means]
        name = "\n".join(wrap(label, 16, break_long_words=False))
        rows.append((means[1], [name, *(count for count, *_ in counts), *ends, *seconds]))
    reached, timed = (f"to\n{error}" for error in errors), (f"s to\n{error}" for error in errors)
    heads = ("solver", *reached, f"sure\n{errors[1]}", "miss", "fail", "late", *timed)
    return Table(heads, [cells for _, cells in sorted(rows, key=lambda row: row[0])])


def profile(entries: Entries, names: Sequence[str], error: float) -> dict[str, list[float]]:
    """Return the times of solvers on instances, relative to the fastest solver."""
    tick = time.get_clock_info("process_time").resolution  # A coarse clock may measure 0 s.
    times = {
        label: [max(seconds_to(own.get(name, ()), error), tick) for name in names] for label, own in entries.items()
    }
    best = [min(column) for column in zip(*times.values(), strict=True)]
    return {
        label: [t / fastest if np.isfinite(t) else np.inf for t, fastest in zip(own, best, strict=True)]
        for label, own in times.items()
    }


def profiles(entries: Entries, instances: Sequence[Row]) -> Figure:
    """Draw performance profiles, with one row per kind and one column per error."""
    kinds = [kind for kind in (PLANE, DISCS) if select_common(entries, instances, kind, ERRORS[1])[1]]
    if not kinds:
        raise VemcvxError("there is no instance that all solvers accept")
    figure, labels = new_figure(11.0, 0.8 + 3.4 * len(kinds)), list(entries)
    grid = figure.subplots(len(kinds), len(ERRORS), sharex=True, sharey=True, squeeze=False)
    for axes, kind in zip(grid, kinds, strict=True):
        for ax, error in zip(axes, ERRORS, strict=True):
            some, names = select_common(entries, instances, kind, error)
            for label, own in (profile(some, names, error) if names else {}).items():
                x = [1.0, *np.sort([one for one in own if np.isfinite(one)]), 1e9]
                fraction = np.minimum(np.arange(len(x)), len(x) - 2) / len(own)
                again, place = divmod(labels.index(label), len(SERIES))
                line = {"color": SERIES[place], "linestyle": ("-", "--", ":", "-.")[again % 4], "linewidth": 1.6}
                ax.step(x, fraction, where="post", label=label, **line)
            ax.set(xscale="log", xlim=(1.0, 1e4), ylim=(0.0, 1.02))
            ax.set_title(f"{kind}, true error {error:.0e}: {len(names)} instances", fontsize="medium")
            plain_logarithms(ax.xaxis, (1.0,))
            light_grid(ax)
        axes[0].set_ylabel("fraction of instances")
    grid[-1][1].set_xlabel("time relative to the fastest solver")
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
    return figure
