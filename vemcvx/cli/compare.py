"""`vemcvx compare`: one problem by several solvers, each with settings tuned for it and as its library comes.

Whatever becomes of a solver is a row: it refuses the program, misses, breaks down, or is out of time. With a time
limit each is given a process of its own, which is ended; then even one that takes its process down is but a row.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from rich.progress import TimeElapsedColumn

from vemcvx.cli.judgement import FAILED, MISSED, REFUSED, STOPPED, Attempt, Judged, judged
from vemcvx.cli.problem_file import Problem, read_problem
from vemcvx.cli.progress import Shown, progress_bar
from vemcvx.cli.solver_names import NAMES, named_solver, read_options
from vemcvx.cost.alone import Crashed, Refused, TookTooLong, alone_within
from vemcvx.errors import NotAccepted, NotCertified, NotContracting, ProblemError, SceneError, VemcvxError
from vemcvx.scene.pose import pose_scene
from vemcvx.simulation import simulate
from vemcvx.solvers import Solver, ThroughCvxpy
from vemcvx.solvers.conic import installed
from vemcvx.solvers.settings import TUNED
from vemcvx.stepping.time_loop import checked_times

SETTINGS = {"both": ("tuned", "default"), "tuned": ("tuned",), "default": ("default",)}


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """What the command line asks for."""

    family: str | None
    n: int
    steps: int
    solvers: str
    accuracy: float | None
    settings: tuple[str, ...]
    options: tuple[str, ...] = ()
    tuning: str = "both"
    time_limit: float | None = None


@dataclass(frozen=True)
class Entrant:
    """A solver that is asked, and whose settings it has: its own, tuned ones, or those of its library."""

    solver: Solver
    settings: str

    @property
    def attempt(self) -> Attempt:
        """Its attempt, before anything came of it."""
        return Attempt(solver=self.solver.name, settings=self.settings, accuracy=self.solver.accuracy)


@dataclass(frozen=True)
class Compared:
    """What was compared, with what settings, and how it came out."""

    title: str
    size: str
    entrants: tuple[Entrant, ...]
    judged: Judged


def compare_solvers(problem: Problem, asked: Comparison, tell: Callable[[str], object] | None = None) -> Compared:
    """Simulate the problem by all solvers asked for; `tell` is called with a sentence on each as soon as it is done.

    Raises
    ------
    VemcvxError
        The problem itself cannot be posed, or names or options of solvers mean nothing.
    """
    if asked.time_limit is not None and not asked.time_limit > 0:
        raise ProblemError(f"--time-limit: found {asked.time_limit:g}; wanted seconds, more than zero.")
    chosen = entrants(asked)
    scene, mesh = problem.scene(asked.settings), problem.mesh(asked.n, asked.family)
    with warned_once(), progress_bar("posing", TimeElapsedColumn()) as shown:
        system = pose_scene(scene, mesh, checked_times(problem.times(asked.steps)).tolist()).system
        attempts = []
        for i in range(len(chosen)):
            attempts.append(_attempted(problem, asked, chosen, i, shown))
            if tell is not None:
                tell(f"{i + 1} of {len(chosen)}: {attempts[-1].in_words}")
        _raise_what_all_say(attempts)
        found = judged(system, _once(attempts))
    size = f"{mesh.n_cells} cells, {mesh.n_nodes} nodes, {system.n} unknowns, {asked.steps} steps"
    return Compared(f"{problem.name}: {problem.title}", size, chosen, found)


def entrants(asked: Comparison) -> tuple[Entrant, ...]:
    """The solvers asked for, by name; those that cvxpy calls with each of the settings asked for."""
    if asked.tuning not in SETTINGS:
        raise ProblemError(f"--tuning: found {asked.tuning!r}; there are {', '.join(SETTINGS)}.")
    # This imports cvxpy: the first solver should not pay for that.
    every = [*NAMES, *(name.lower() for name in installed() if name.lower() not in NAMES)]
    typed = [name.strip() for name in asked.solvers.split(",") if name.strip()]
    typed = [name if ":" in name else name.lower() for name in typed]
    names = list(dict.fromkeys(one for name in typed for one in (every if name == "all" else [name])))
    if not names:
        raise ProblemError(f"--solvers: found {asked.solvers!r}; wanted names such as newton,clarabel,SCS, or all.")
    options = read_options(asked.options, names)
    solvers = [named_solver(name, asked.accuracy, "--solvers", options.get(name, {})) for name in names]
    return tuple(entrant for solver in solvers for entrant in _with_settings(solver, SETTINGS[asked.tuning]))


def _with_settings(solver: Solver, wanted: Sequence[str]) -> list[Entrant]:
    if not isinstance(solver, ThroughCvxpy):
        return [Entrant(solver, "own")]
    if solver.solver not in TUNED:
        return [Entrant(replace(solver, tuned=False), "default")]
    return [Entrant(replace(solver, tuned=settings == "tuned"), settings) for settings in wanted]


def _attempted(problem: Problem, asked: Comparison, chosen: Sequence[Entrant], i: int, shown: Shown | None) -> Attempt:
    entrant = chosen[i]
    label = f"{entrant.attempt.label}, {i + 1} of {len(chosen)}"

    def advance(n: int, steps: int) -> None:
        if shown is not None:
            shown(label, n, steps)

    if asked.time_limit is None:
        advance(0, asked.steps)
        return attempted(problem, asked, entrant, advance)
    if shown is not None:
        shown(label, i, len(chosen))
    try:
        return alone_within(asked.time_limit, installed, attempted_alone, path=problem.path, asked=asked, i=i)
    except TookTooLong:
        return replace(entrant.attempt, outcome=STOPPED, says=f"stopped after {asked.time_limit:g} s")
    except Crashed as crash:
        return replace(entrant.attempt, outcome=FAILED, says=f"its process ended: {crash}")
    except Refused as refusal:
        return replace(entrant.attempt, outcome=FAILED, says=_own_words(str(refusal)))


def attempted_alone(path: Path, asked: Comparison, i: int) -> Attempt:
    """The attempt of entrant `i`, in a process that has read nothing yet."""
    return attempted(read_problem(path), asked, entrants(asked)[i], None)


def attempted(
    problem: Problem, asked: Comparison, entrant: Entrant, progress: Callable[[int, int], None] | None
) -> Attempt:
    """What a solver makes of the problem."""
    scene, mesh = problem.scene(asked.settings), problem.mesh(asked.n, asked.family)
    times, solver = problem.times(asked.steps), entrant.solver
    advance = False if progress is None else progress
    try:
        history = simulate(scene, mesh, times, solver=solver, initial=problem.initial, check=False, progress=advance)
    except NotAccepted as error:
        return replace(entrant.attempt, outcome=REFUSED, says=clause(str(error)))
    except (NotCertified, NotContracting) as error:
        return replace(entrant.attempt, outcome=MISSED, says=clause(str(error)))
    except VemcvxError as error:
        return replace(entrant.attempt, outcome=FAILED, says=_own_words(str(error)))
    except MemoryError:
        return replace(entrant.attempt, outcome=FAILED, says="it ran out of memory")
    return replace(entrant.attempt, trajectory=history.trajectory, seconds=dict(history.seconds))


def _raise_what_all_say(attempts: Sequence[Attempt]) -> None:
    """An error that every solver ends in, of those that take the program, is one of the problem."""
    tried = [(attempt.outcome, attempt.says) for attempt in attempts if attempt.outcome != REFUSED]
    if len(tried) > 1 and len(set(tried)) == 1 and tried[0][0] == FAILED:
        raise SceneError(tried[0][1])


def _once(attempts: Sequence[Attempt]) -> list[Attempt]:
    """A solver that refuses the program with all settings is told once."""
    told = [(a.solver, a.says) if a.outcome == REFUSED else i for i, a in enumerate(attempts)]
    return [a for i, a in enumerate(attempts) if told.index(told[i]) == i]


@contextmanager
def warned_once() -> Iterator[None]:
    """Say each warning once, however many solvers meet it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for words, kind in dict.fromkeys((str(warning.message), warning.category) for warning in caught):
        warnings.warn(words, kind, stacklevel=2)


def clause(message: str) -> str:
    """An error's first clause, without the name of the solver before it."""
    return re.split(r"[;.](?:\s|$)", _own_words(message), maxsplit=1)[0]


def _own_words(message: str) -> str:
    """An error without the name of the solver before it."""
    return re.sub(r"^solver \S+: ", "", message).removesuffix(".")
