"""A collection of instances with certified answers, written for authors of solvers."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from vemcvx.cli.problem_file import read_problem
from vemcvx.cli.supplied import problems_folder
from vemcvx.cli.terminal import progress_bar, say
from vemcvx.errors import ProblemError
from vemcvx.exchange import FORMATS, encoded, put
from vemcvx.owned_files import Owned
from vemcvx.program import SolvedProgram
from vemcvx.simulation import programs
from vemcvx.version import __version__

VERSION = 2
"""The version of the list below: other instances, or others under the same names, are another version."""


@dataclass(frozen=True, kw_only=True)
class Instance:
    """Step `step` of a run of `of` steps of a problem file, with n cells per unit length and settings "name=value".

    The grade is the reason why the program is hard; "pressure" is Coulomb's friction, "discs" friction in space. In a
    degenerate instance the weights of terms that stick are lowered to what these carry: the answer stays, and every
    such term is at once at rest and at its bound.
    """

    grade: str
    problem: str
    n: int
    of: int
    step: int
    settings: tuple[str, ...] = ()
    condense: bool = True
    degenerate: bool = False

    @property
    def name(self) -> str:
        """A word with all settings but the grade."""
        ends = ("-full" * (not self.condense), "-degenerate" * self.degenerate)
        settings = "".join(f"-{setting.replace('=', '')}" for setting in self.settings)
        return f"{self.problem}-n{self.n}-{self.step}of{self.of}{settings}{''.join(ends)}"

    @property
    def run(self) -> tuple[str, int, int, tuple[str, ...], bool]:
        """The run that it is a step of."""
        return self.problem, self.n, self.of, self.settings, self.condense


SI = "young=2e11", "bound=4e9", "push=8e9", "press=1e7"
TINY = "young=2e-4", "bound=4e-6", "push=8e-6", "press=1e-8"
PAPER = "feng_han_huang"

# grade, problem, cells per unit length, steps, settings
Row = tuple[str, str, tuple[int, ...], tuple[int, ...], tuple[str, ...]]
PLAIN: tuple[str, ...] = ()
NEAR_HALF = ("poisson=0.499",), ("poisson=0.49999",), ("poisson=0.4999999",)
CONDENSED: tuple[Row, ...] = (
    ("easy", PAPER, (8, 16), (4, 8), PLAIN),
    ("easy", "frictional_hysteresis", (4, 8), (2,), PLAIN),
    ("easy", "manufactured_full_slip", (8, 16), (2,), PLAIN),
    ("sizes", PAPER, (32, 64), (4, 8), PLAIN),
    ("bounds", "hertz_contact", (6, 12), (2, 8), PLAIN),
    ("bounds", "block_between_dies", (6, 12), (2,), PLAIN),
    ("bounds", "beam_on_a_stop", (6,), (2, 8), PLAIN),
    ("pressure", "cattaneo_mindlin", (6,), (2, 8), PLAIN),
    ("pressure", "janssen_silo", (4,), (2, 8), PLAIN),
    ("pressure", "block_with_grain", (6, 12), (2, 8), PLAIN),
    ("soft", "rough_layer", (6, 12), (2, 8), PLAIN),
    ("viscous", "kelvin_voigt_creep", (6,), (2, 5, 8), PLAIN),
    ("sticking", "shear_lag", (6,), (2, 5, 8), PLAIN),
    ("sticking", "thermal_expansion_blocked_by_friction", (6,), (2, 5, 8), PLAIN),
    ("sticking", "l_shaped_bracket", (8, 16), (6, 8), PLAIN),
    *(("incompressible", PAPER, (16,), (8,), near) for near in NEAR_HALF),
    *(("units", PAPER, (8, 16), (8,), units) for units in (SI, TINY)),
    ("discs", "block_in_space", (4,), (4, 8), PLAIN),
    ("discs", "block_in_space", (8,), (8,), PLAIN),
    ("discs", "circular_hysteresis", (2,), (4, 8), PLAIN),
    ("discs", "block_dragged_along_a_curve", (4,), (8,), PLAIN),
)
ON_ALL_UNKNOWNS: tuple[Row, ...] = (
    ("sizes", PAPER, (8, 16, 32), (4, 8), PLAIN),
    ("sizes", PAPER, (64,), (8,), PLAIN),
    ("bounds", "hertz_contact", (6,), (8,), PLAIN),
    ("pressure", "block_with_grain", (6,), (8,), PLAIN),
    ("viscous", "kelvin_voigt_creep", (6,), (8,), PLAIN),
    *(("incompressible", PAPER, (16,), (8,), near) for near in NEAR_HALF),
    *(("units", PAPER, (8,), (8,), units) for units in (SI, TINY)),
    ("discs", "block_in_space", (4,), (8,), PLAIN),
)
DEGENERATE: tuple[Row, ...] = (
    ("degenerate", "l_shaped_bracket", (8, 16), (6, 8), PLAIN),
    ("degenerate", PAPER, (16, 32), (6, 8), PLAIN),
)
INSTANCES = tuple(
    Instance(
        grade=grade,
        problem=problem,
        n=n,
        of=8,
        step=step,
        settings=settings,
        condense=rows is not ON_ALL_UNKNOWNS,
        degenerate=rows is DEGENERATE,
    )
    for rows in (CONDENSED, ON_ALL_UNKNOWNS, DEGENERATE)
    for grade, problem, cells, steps, settings in rows
    for n in cells
    for step in steps
)


MANIFEST, SCRIPT = "manifest.json", "confirm.py"


def write_collection(
    folder: Path,
    beside: str | None = None,
    instances: Sequence[Instance] = INSTANCES,
    told: Callable[[str, int, int], None] = lambda *_: None,
) -> str:
    """Make every instance, write a file and its words for each, a manifest and the script; `beside` is a format.

    Returns a summary in words. `told` is called with (name, done, total).
    """
    if beside is not None and beside not in FORMATS:
        raise ProblemError(f"--format: there is no format {beside!r}; there are {', '.join(FORMATS)}.")
    forms = tuple(dict.fromkeys([*([beside] if beside else []), "npz"]))
    rows = []
    with Owned(folder) as files:
        for done, (instance, program) in enumerate(_made(instances)):
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


@dataclass(frozen=True, kw_only=True)
class Collection:
    """Write the graded collection of convex programs, with certified optima and a script that confirms them."""

    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder to write to.")] = Path("collection")
    form: Annotated[
        str | None, typer.Option("--format", metavar="mtx|cbf|qps|mps", help="A format to write beside npz.")
    ] = None

    def __call__(self) -> None:
        """Write it, and say what there is."""
        with progress_bar("reading") as shown:
            say(write_collection(self.out, self.form, told=shown))


def _made(instances: Sequence[Instance]) -> Iterator[tuple[Instance, SolvedProgram]]:
    """The instances with their programs; those of one run come from one run."""
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
    # Terms whose weight is lowered stick below this part of the largest slip.
    sticks = size <= 1e-9 * size.max(initial=0.0)
    lower = np.where(sticks, np.linalg.norm(program.answer.lam, axis=1), program.w)
    return replace(program, w=np.minimum(lower, program.w))
