"""The collection written: a file and its words an instance, a manifest, and the script that confirms the optima."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from vemcvx.cli.collection.instances import INSTANCES, VERSION, Instance
from vemcvx.cli.problem_file import read_problem
from vemcvx.cli.supplied import problems_folder
from vemcvx.errors import ProblemError
from vemcvx.exchange import FORMATS, encoded, put
from vemcvx.owned_files import Owned
from vemcvx.program import SolvedProgram
from vemcvx.simulation import programs
from vemcvx.version import __version__

MANIFEST, SCRIPT = "manifest.json", "confirm.py"
STICKING = 1e-9
"""Part of the largest slip, below which a term sticks whose weight is lowered."""


def write_collection(
    folder: Path,
    beside: str | None = None,
    instances: Sequence[Instance] = INSTANCES,
    told: Callable[[str, int, int], None] | None = None,
) -> str:
    """Make every instance, and write what a reader needs; in words, what there is.

    Parameters
    ----------
    folder : Path
    beside : str, optional
        A format to write beside NPZ.
    instances : sequence of Instance
    told : callable (name, done, total), optional

    Raises
    ------
    VemcvxError
        A problem file is not there, there is no such format, or something cannot be written.
    """
    if beside is not None and beside not in FORMATS:
        raise ProblemError(f"--format: there is no format {beside!r}; there are {', '.join(FORMATS)}.")
    forms = tuple(dict.fromkeys([*([beside] if beside else []), "npz"]))
    rows = []
    with Owned(folder) as files:
        for done, (instance, program) in enumerate(_made(instances)):
            if told is not None:
                told(instance.name, done, len(instances))
            data = {end: data for form in forms for end, data in encoded(program, form).items() if data is not None}
            put({f"{instance.name}{end}": content for end, content in data.items()}, files.take)
            rows.append({"name": instance.name, **asdict(instance), **json.loads(data[".json"])})
        made = {"collection": VERSION, "vemcvx": __version__, "instances": rows}
        files.take(MANIFEST).write_text(json.dumps(made, indent=1) + "\n")
        files.take(SCRIPT).write_text(Path(__file__).with_name(SCRIPT).read_text())
    sizes = [row["unknowns"] for row in rows]
    return (
        f"{len(rows)} instances of 'vemcvx collection {VERSION}' in {folder}: {min(sizes)} to {max(sizes)} unknowns\n"
        f"{MANIFEST} has sizes, nonzeros, degenerate terms, conditions, certified optima; python {SCRIPT} confirms them"
    )


def _made(instances: Sequence[Instance]) -> Iterator[tuple[Instance, SolvedProgram]]:
    """Each with its program; those of one run from one run."""
    here = problems_folder()
    for _, group in groupby(sorted(instances, key=lambda one: (*one.run, one.step)), key=lambda one: one.run):
        wanted = list(group)
        first, last = wanted[0], max(one.step for one in wanted)
        problem = read_problem(here / f"{first.problem}.py")
        marched = programs(
            problem.scene(first.settings),
            problem.mesh(first.n),
            np.asarray(problem.times(first.of))[: last + 1],
            initial=problem.initial,
            condense=first.condense,
        )
        for program in marched:
            for one in wanted:
                if one.step == program.step:
                    yield one, _barely_sticking(program) if one.degenerate else program


def _barely_sticking(program: SolvedProgram) -> SolvedProgram:
    """The program whose terms that stick have just the weight that they need."""
    size = np.linalg.norm(program.slip(program.answer.d), axis=1)
    sticks = size <= STICKING * size.max(initial=0.0)
    lower = np.where(sticks, np.linalg.norm(program.answer.lam, axis=1), program.w)
    return replace(program, w=np.minimum(lower, program.w))
