"""`vemcvx export`: the convex programs of some steps as files, with words beside them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from vemcvx.cli.problem_file import Problem
from vemcvx.cli.run import simulated
from vemcvx.cli.run_options import RunOptions
from vemcvx.errors import ProblemError
from vemcvx.exchange import FORMATS, encoded, put
from vemcvx.owned_files import Owned
from vemcvx.program import SolvedProgram
from vemcvx.results.programs import programs_of_steps


def export_programs(problem: Problem, asked: RunOptions, steps: str, form: str) -> str:
    """Simulate, write the programs of the steps "3,17", and say in words what was written.

    Raises
    ------
    VemcvxError
        Something asked for does not exist, or cannot be solved, certified or written.
    """
    numbers = _numbers(steps, asked.steps)
    if form not in FORMATS:
        raise ProblemError(f"--format: there is no format {form!r}; there are {', '.join(FORMATS)}.")
    with Owned(asked.out or Path("results") / f"programs_{problem.name}") as folder:
        kept = sorted({m for n in numbers for m in (n - 1, n)})
        history, _ = simulated(problem, replace(asked, store=tuple(kept)))
        lines = [f"{problem.name}: {problem.title}", f"files       {folder.path}"]
        for program in programs_of_steps(history, numbers, asked.condense):
            origin = {"problem": problem.name, "settings": list(asked.settings), **program.origin}
            lines.append(_written(replace(program, origin=origin), f"{problem.name}_{program.step}", form, folder))
    return "\n".join(lines)


def _written(program: SolvedProgram, name: str, form: str, folder: Owned) -> str:
    files = {f"{name}{end}": data for end, data in encoded(program, form).items()}
    put({file: data for file, data in files.items() if data or file in folder.names}, folder.take)
    low, high = program.bounds
    counts = f"{len(program.g)} unknowns, {len(program.w)} norm terms, {len(program.e)} limits"
    return f"{name}.{form}  {counts}; the optimum is between {low:.17g} and {high:.17g}"


def _numbers(typed: str, last: int) -> list[int]:
    """Step numbers, in the order typed, each once."""
    words = [word.strip() for word in typed.split(",")]
    if not all(word.isdecimal() and 1 <= int(word) <= last for word in words):
        raise ProblemError(
            f"--steps: found {typed!r}; wanted numbers from 1 to {last} with commas between, such as 1,{last}; --of "
            "says how many steps the run has."
        )
    return list(dict.fromkeys(int(word) for word in words))
