"""One solver on the instances of a collection: asked with many tolerances, timed, and held against the optimum.

A trial is one call of a solver with one tolerance. With d* the certified optimum of the file and d what the solver
answers, its *true error* is

    |d - d*|_K / |d*|_K,

known up to the certificate of d*, which the file has. Beside it stand the certified error of the answer, which needs no
d* (:meth:`vemcvx.program.step_program.StepProgram.certify`), its duality gap, and the residuals

    primal  max_j (D_j d - e_j)_+ / max (|D||d*| + |e|)  over the bounds,  dual  |g - B'lam - D'p - K d|_oo / |g|_oo.

All are given the program scaled by powers of two (:mod:`vemcvx.program.scaling`), as in a run, so that no tolerance is
one in the units of a file. Solvers that cvxpy calls run as their libraries come, but for the tolerance, one number for
all that the library has, and for limits on iterations, which make way for the limit on seconds. Ours, and those in
files of users, have the duality gap 1/2 (tolerance |d*|)^2 as their target. Solvers that do not take a semidefinite K
are refused where K has a kernel. A sequence is asked for step by step, once cold and once warm, where every step is
given what the one before has left: to solvers that cvxpy calls as it hands that on, answer or factors, to others their
own multipliers. Errors are then the largest of all steps, in units of the largest |d*|_K, seconds and iterations those
of all together. Seconds are of the processor, all threads together, for set-up and solve of the library, without
cvxpy's compilation: the least of up to five calls within a tenth of a second. The limit is of the processor, too, where
the system can count it, so that a busy machine makes nobody late; who does not compute at all is ended by the clock.

Tolerances go from loose to tight, until the true error is at most the least that is asked of any and the certified one
at most the middle one, or a trial does not end. Trials run in processes of their own. Each is written down before it
begins and after it has ended, so that a process that dies or is out of time shows where; the next one goes on behind.
"""

from __future__ import annotations

import faulthandler
import json
import os
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

try:
    import resource
except ImportError:  # on Windows
    resource = None  # type: ignore[assignment]

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import NotAccepted, ProblemError, VemcvxError, quietly
from vemcvx.base.version import __version__
from vemcvx.cli.solver_names import named_solver
from vemcvx.cost.workers import Crashed, alone
from vemcvx.exchange import sequence_from_npz
from vemcvx.program.scaling import Scaling
from vemcvx.program.step_program import Answer, SolvedProgram, StepProgram
from vemcvx.solvers import Solver, ThroughCvxpy
from vemcvx.solvers.solver import Prepared, named_failures

ASKED = 1e-3, 1e-6, 1e-9
"""Relative errors in energy norm by which solvers are compared."""
ANSWERED, FAILED, STOPPED, REFUSED = "answered", "failed", "out of time", "refused"
"""What a trial comes to: an answer, however good; none; none in time; a program that the solver does not take."""
REPEATS, LONG_ENOUGH = 5, 0.1
"""Calls of a trial, and the seconds after which it is called no more: the least of these is what others repeat."""
COUNTS = hasattr(signal, "setitimer")
"""Whether the system ends a process by its seconds of the processor; Windows does not."""
BY_CLOCK = 10.0 if COUNTS else 1.0
"""Seconds by the clock in which a trial must get one of the processor."""
LIBRARIES: Mapping[str, tuple[tuple[str, ...], Mapping[str, int]]] = {
    "CLARABEL": (("tol_gap_abs", "tol_gap_rel", "tol_feas"), {"max_iter": 10_000}),
    "CVXOPT": (("abstol", "reltol", "feastol"), {"max_iters": 10_000}),
    "DAQP": (("primal_tol", "dual_tol"), {}),
    "ECOS": (("abstol", "reltol", "feastol"), {"max_iters": 10_000}),
    "HIGHS": (("primal_feasibility_tolerance", "dual_feasibility_tolerance"), {}),
    "OSQP": (("eps_abs", "eps_rel"), {"max_iter": 10**9}),
    "PIQP": (("eps_abs", "eps_rel"), {"max_iter": 10_000}),
    "PROXQP": (("eps_abs", "eps_rel"), {"max_iter": 10**9}),
    "QOCO": (("abstol", "reltol"), {"max_iters": 10_000}),
    "SCS": (("eps_abs", "eps_rel"), {"max_iters": 10**9}),
}
"""What cvxpy calls the tolerances of solvers, and limits on iterations that never end a trial before its seconds do;
solvers that are not in this table are tried once, as they come."""
LEAST: Mapping[str, float] = {"HIGHS": 1e-10}
"""The least tolerance that a library takes."""
PACKAGES = {"CLARABEL": "clarabel", "HIGHS": "highspy", "PROXQP": "proxsuite"}
"""Packages that are not called as cvxpy calls the solver, but for capitals."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """The outcome of a solver, asked with a tolerance, on an instance."""

    instance: str
    digest: str  # the beginning of the SHA-256 of its file: results for another file of that name do not count
    tolerance: float | None  # what the solver was asked with; None where it has none
    outcome: str  # ANSWERED, FAILED, STOPPED or REFUSED
    limit: float  # seconds that it had
    begun: float | None = None  # of a trial that has not ended: when, in seconds since 1970
    seconds: float | None = None
    true: float | None = None
    certified: float | None = None
    gap: float | None = None
    primal_residual: float | None = None
    dual_residual: float | None = None
    iterations: int | None = None
    says: str = ""

    @property
    def enough(self) -> bool:
        """True if tighter tolerances would tell no more."""
        if self.true is None or self.certified is None:
            return False
        return self.true <= min(ASKED) and self.certified <= ASKED[1]


@dataclass(frozen=True)
class Entrant:
    """A solver that takes part: its name as it was typed, and settings of its library beside the tolerance."""

    typed: str
    options: tuple[tuple[str, Any], ...] = ()

    @property
    def solver(self) -> Solver:
        """The solver itself: one of ours, of a user's file, or of cvxpy's."""
        return named_solver(self.typed, None, "--solvers")

    @property
    def name(self) -> str:
        """The name in tables; a solver with settings of its own is another entrant."""
        words = "".join(f" {name}={value}" for name, value in self.options)
        return f"{self.solver.name if ':' in self.typed else self.typed.lower()}{words}"

    @property
    def version(self) -> str:
        """The version of its library, of this package, or of the contents of the user's file."""
        if ":" in self.typed:
            return sha256(Path(self.typed.rpartition(":")[0]).read_bytes()).hexdigest()[:8]
        if not isinstance(self.solver, ThroughCvxpy):
            return __version__
        name = self.typed.upper()
        try:
            return version(PACKAGES.get(name, name.lower()))
        except PackageNotFoundError:
            return "unknown"

    def ladder(self, tolerances: Sequence[float]) -> tuple[float | None, ...]:
        """The tolerances that it is asked with, from loose to tight."""
        name = self.typed.upper()
        if isinstance(self.solver, ThroughCvxpy) and name not in LIBRARIES:
            return (None,)
        return tuple(sorted({max(one, LEAST.get(name, 0.0)) for one in tolerances}, reverse=True))

    def taking(self, programs: Sequence[StepProgram]) -> list[Asking]:
        """Functions of a tolerance that solve these programs of the same operators, compiled or scaled once.

        NotAccepted where the solver does not take such a program, or is not installed.
        """
        solver, operators = self.solver, programs[0].operators
        missing = operators.features - solver.accepts
        if missing:
            raise NotAccepted(f"solver {self.name}: takes no {' and no '.join(sorted(missing))}.")
        scales = Scaling.of(operators)
        alpha = max(scales.length(program) for program in programs)
        if isinstance(solver, ThroughCvxpy):
            solver.prepare(operators)
            name, options = self.typed.upper(), dict(self.options)
            return [_through_cvxpy(scales.scale(program, alpha), scales, alpha, name, options) for program in programs]
        if self.options:
            raise ProblemError(f"--option: {self.name} is not called through cvxpy; set its settings in its own file.")
        if operators.kernel is not None and not solver.semidefinite:
            raise NotAccepted(f"solver {self.name}: takes no semidefinite K; only friction and contact hold the body.")
        prepared, unit = solver.prepare(scales.operators), _unit(programs)
        return [_own(scales.scale(program, alpha), scales, alpha, prepared, unit) for program in programs]


Found = tuple[float, Floats | None, Floats | None, Floats | None, int | None, str]
"""Seconds, d if there is an answer, lam, p, iterations, and what the solver says."""
Memory = dict[str, Any] | None
"""What the answer to a step of a sequence leaves for the next; empty before the first, None where each begins cold."""
Asking = Callable[[float | None, Memory], Found]


def processor_seconds() -> float:
    """The seconds of the processor that this process has taken, all threads together.

    While a limit is set, Linux counts time.process_time() in ticks of 4 ms, and what ended between two as nothing.
    """
    if resource is None:
        return time.process_time()
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _through_cvxpy(scaled: StepProgram, scales: Scaling, alpha: float, name: str, options: dict[str, Any]) -> Asking:
    posed = scaled.to_cvxpy()
    data, chain, inverse = posed.problem.get_problem_data(name, solver_opts={})
    tolerances, unlimited = LIBRARIES.get(name, ((), {}))

    def ask(tolerance: float | None, memory: Memory) -> Found:
        # Some of cvxpy's interfaces change the dictionaries that they are given.
        given = {**unlimited, **dict.fromkeys(tolerances, tolerance), **options}, {} if memory is None else memory
        start = processor_seconds()
        raw = chain.solver.solve_via_data(dict(data), memory is not None, False, *given)
        seconds = processor_seconds() - start
        posed.problem.unpack_results(raw, chain, inverse)
        stats, status, d = posed.problem.solver_stats, posed.problem.status, posed.d.value
        iterations = None if stats is None else stats.num_iters
        if d is None or posed.lam is None or posed.p is None:
            return seconds, None if d is None else alpha * d, None, None, iterations, status
        found = scales.restore(Answer(d, posed.lam, 0, p=posed.p), alpha)
        return seconds, found.d, found.lam, found.p, iterations, status

    return ask


def _own(scaled: StepProgram, scales: Scaling, alpha: float, prepared: Prepared, unit: float) -> Asking:
    nothing = np.zeros((len(scaled.w), scaled.operators.block)), np.zeros_like(scaled.e)

    def ask(tolerance: float | None, memory: Memory) -> Found:
        force = scales.kappa * alpha
        target = scales.energy(0.5 * ((tolerance or 0.0) * unit) ** 2, alpha)
        begin = (memory["lam"] / force, memory["p"] / force) if memory else nothing
        start = processor_seconds()
        answer = prepared.solve(scaled, target, *begin)
        seconds = processor_seconds() - start
        answer = scales.restore(answer, alpha)
        if memory is not None:
            memory |= {"lam": answer.lam, "p": answer.p}
        # Who returns arrays alone does not say how many iterations they took.
        return seconds, answer.d, answer.lam, answer.p, answer.iterations or None, answer.status

    return ask


def _unit(programs: Sequence[StepProgram]) -> float:
    """The largest |d*|_K; 1 where that is zero, or there is no d*."""
    return max((program.norm for program in programs if isinstance(program, SolvedProgram)), default=0.0) or 1.0


def measured(
    asks: Sequence[Asking], programs: Sequence[StepProgram], tolerance: float | None, *, status: str = "", warm: bool
) -> dict[str, Any]:
    """The fields of a trial: sums of seconds and iterations over the steps of an instance, the largest of all else.

    A step that is alone is asked for several times, and its least seconds count. Where the program has no optimum, its
    `status` is what a solver is to say: that has no error, all else is of size 1.

    SolverFailed where the solver fails, or an answer is not finite; NotAccepted where it is to begin warm, and leaves
    nothing to begin with.
    """
    memory: Memory = {} if warm else None
    unit, taken, counts, judged = _unit(programs), 0.0, list[int](), list[dict[str, float]]()
    with named_failures("asked"), quietly():  # What a library warns of, its status says.
        for ask, program in zip(asks, programs, strict=True):
            begun = time.perf_counter()
            seconds, d, lam, p, iterations, says = ask(tolerance, memory)
            for _ in range(REPEATS - 1 if len(programs) == 1 else 0):
                if time.perf_counter() - begun > LONG_ENOUGH:
                    break
                seconds = min(seconds, ask(tolerance, None)[0])
            taken += seconds
            counts += [] if iterations is None else [int(iterations)]
            if status:
                error = 0.0 if says.lower().removesuffix("_inaccurate") == status else 1.0
                judged.append({"true": error, "certified": error})
                continue
            if d is None:
                raise ValueError(f"{says}, without an answer")
            if not np.isfinite(d).all():
                raise ValueError("its answer is not finite")
            judged.append(_judged(program, d, lam, p, unit))
    if memory == {}:
        raise NotAccepted("begins cold: it is handed nothing of the answer before.")
    worst = {name: max(one[name] for one in judged) for name in judged[0]}
    return {"seconds": taken, "iterations": sum(counts) if counts else None, "says": says, **worst}


def _judged(program: StepProgram, d: Floats, lam: Floats | None, p: Floats | None, unit: float) -> dict[str, float]:
    """Errors, in this unit, and residuals of an answer."""
    assert isinstance(program, SolvedProgram)
    operators, best = program.operators, program.answer.d
    certificate = program.certify(d, lam, p)
    lam, p = program.multipliers(d, lam, p)
    apart, rigid = d - best, operators.compliance == 0
    square = float(apart @ (operators.K @ apart))
    size = np.abs(program.e) + abs(operators.D) @ np.abs(best) if len(program.e) else np.zeros(1)
    return {
        "true": max(square, 0.0) ** 0.5 / unit,
        "certified": float(certificate.error + certificate.error_floor) / unit,
        "gap": float(certificate.gap),
        "primal_residual": float(program.excess(d)[rigid].max(initial=0.0) / (size.max(initial=0.0) or 1.0)),
        "dual_residual": float(abs(program.residual(d, lam, p)).max() / (abs(program.g).max() or 1.0)),
    }


# The journal of a solver: a line when a trial begins, a line when it ends.


def journal(path: Path) -> list[Trial]:
    """The trials in a journal; one that began and did not end, the process died in."""
    trials: list[Trial] = []
    known = {field.name for field in fields(Trial)}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            record = json.loads(line)
        except ValueError:
            continue  # torn, when its process died
        if isinstance(record, dict) and known >= set(record) and {"instance", "digest", "outcome"} <= set(record):
            trials.append(Trial(**record))
    return trials


def note(path: Path, trial: Trial) -> None:
    """Append a trial to the journal."""
    with path.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(asdict(trial)) + "\n")


BEGUN = "begun"
WARM = ", warm"
"""The end of the name of a sequence where it is asked for warm."""
Work = tuple[str, str, tuple[float | None, ...]]
"""An instance, its digest, and the tolerances that are left to be tried."""


def left(trials: Sequence[Trial], work: Sequence[Work], limit: float) -> Iterator[Work]:
    """The part of the work that the trials do not answer; what was out of time is tried again where there is more."""
    for instance, digest, ladder in work:
        own = [one for one in trials if one.instance == instance and one.digest == digest]
        late = any(one.outcome == STOPPED and one.limit >= limit for one in own)
        ended = late or any(one.outcome in (REFUSED, FAILED) or one.enough for one in own)
        done = {one.tolerance for one in own if one.outcome == ANSWERED}
        rest = tuple(one for one in ladder if one not in done)
        if rest and not ended:
            yield instance, digest, rest


@dataclass(frozen=True)
class Running:
    """A solver on the instances of a folder, with so many seconds a trial, and the journal of its trials."""

    folder: Path
    entrant: Entrant
    limit: float
    path: Path

    def try_all(self, work: Sequence[Work]) -> None:
        """Try the solver on instances, in processes of its own, until no work is left."""
        while todo := list(left(journal(self.path), work, self.limit)):
            died = ""
            try:
                alone(Running.tried, self, todo)
            except (Crashed, VemcvxError) as error:
                died = str(error)
            last = journal(self.path)[-1:]
            if last and last[0].outcome == BEGUN:
                waited = time.time() - (last[0].begun or np.inf)
                late = waited >= BY_CLOCK * self.limit or (COUNTS and died.endswith(f"signal {signal.SIGPROF.value}"))
                outcome, words = (STOPPED, "") if late else (FAILED, f"its process ended: {died}")
                note(self.path, replace(last[0], outcome=outcome, begun=None, says=words))
            elif died:
                raise ProblemError(f"benchmark: {self.entrant.name} ended before it tried anything: {died}")

    def tried(self, work: Sequence[Work]) -> None:
        """Try it on instances in this process, which ends where a trial takes longer than the limit."""
        for instance, digest, ladder in work:
            name = instance.removesuffix(WARM)
            programs = sequence_from_npz(self.folder / f"{name}.npz")
            status = json.loads((self.folder / f"{name}.json").read_text(encoding="utf-8")).get("status", "")
            if not status and not isinstance(programs[0], SolvedProgram):
                raise ProblemError(f"{self.folder / name}.npz: has no answer to compare with.")
            trial = partial(Trial, instance=instance, digest=digest, limit=self.limit)
            asks, asked = None, ladder[0]
            try:
                for asked in ladder:
                    note(self.path, trial(tolerance=asked, outcome=BEGUN, begun=time.time()))
                    asks = asks or self.entrant.taking(programs)
                    with ended_after(self.limit):
                        found = measured(asks, programs, asked, status=status, warm=name != instance)
                    note(self.path, answer := trial(tolerance=asked, outcome=ANSWERED, **found))
                    if answer.enough:
                        break
            except NotAccepted as error:
                note(self.path, trial(tolerance=None, outcome=REFUSED, says=str(error)))
            except VemcvxError as error:
                note(self.path, trial(tolerance=asked, outcome=FAILED, says=str(error)))


@contextmanager
def ended_after(seconds: float) -> Iterator[None]:
    """End this process, whatever it is doing, if what is within takes longer."""
    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(BY_CLOCK * seconds, exit=True, file=nowhere)
        if COUNTS:
            signal.setitimer(signal.ITIMER_PROF, seconds)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
            if COUNTS:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
