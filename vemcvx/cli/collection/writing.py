"""A collection of programs with certified optima: each program is a step of a run.

Each program or sequence of programs has a grade. *easy*: the scene of Feng, Han and Huang, and scenes with closed
forms. *sizes*: the first scene on other meshes. *bounds*: one-sided contact. *pressure*: Coulomb's law, with friction
bounds from the pressures of the solution. *discs*: friction in space, with one second-order cone per contact node.
*bodies*: several bodies. *floating*: the stiffness K has a kernel, because only friction and contact hold the bodies.
*soft*: compliant obstacles. *viscous*: viscous materials. *sticking*: few nodes slip. *degenerate*: many nodes have
zero slip and a friction force at its bound. *incompressible*: K has a condition number up to 1e9. *units*: numbers of
unusual magnitude. *large*: sparse K with up to a million unknowns. *no optimum*: infeasible or unbounded programs, with
a certificate. *sequences*: the 256 steps of a run; each answer is a warm start for the next step.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import scipy.sparse as sp
import typer

from vemcvx.base.arrays import ROUNDING, SAME, Floats
from vemcvx.base.owned_files import Owned
from vemcvx.base.table import Table
from vemcvx.base.version import __version__
from vemcvx.cli.problem_file import read_problem
from vemcvx.cli.supplied import problems_folder
from vemcvx.cli.terminal import limit_log, progress_bar, say
from vemcvx.exchange import description, encode_program, in_json, sequence_to_npz
from vemcvx.program import SolvedProgram, StepProgram
from vemcvx.results import programs_of_steps
from vemcvx.scene import suppress_scene_warnings
from vemcvx.solvers import Newton

VERSION = 5  # Increase this number whenever an instance changes, even if no name changes.
MANIFEST, OPTIMA, SCRIPT = "manifest.json", "optima.csv", "confirm.py"
TEXTS = "README.md", "LICENSE.txt", "CITATION.cff"
"""Files of this folder that are copied into a collection, with version numbers filled in."""
ACCURACY = 1e-14  # The requested accuracy of optima, smaller than rounding errors.
INFEASIBLE, UNBOUNDED = "infeasible", "unbounded"


@dataclass(frozen=True, kw_only=True)
class CollectionInstance:
    """One step, or a sequence of steps, from a run."""

    grade: str
    problem: str  # name of the problem file
    n: int  # argument of the function `mesh` of the problem file
    of: int  # number of steps of the run
    step: int
    settings: tuple[str, ...] = ()  # parameters of the scene, "name=value"
    condense: bool = True
    degenerate: bool = False  # True if weights of sticking terms are lowered to |lam|
    without: str = ""  # reason why there is no optimum: INFEASIBLE or UNBOUNDED
    steps: int = 1  # length of a sequence that ends with `step`

    @property
    def name(self) -> str:
        """The name, made of all fields except the grade."""
        ends = "-full" * (not self.condense), "-degenerate" * self.degenerate, f"-{self.without}" * bool(self.without)
        settings = "".join(f"-{setting.replace('=', '')}" for setting in self.settings)
        steps = f"{self.step - self.steps + 1}to" * (self.steps > 1) + f"{self.step}of{self.of}"
        return f"{self.problem}-n{self.n}-{steps}{settings}{''.join(ends)}"

    @property
    def run(self) -> tuple[str, int, int, tuple[str, ...]]:
        """The problem, the argument n of `mesh`, the number of steps, and the settings."""
        return self.problem, self.n, self.of, self.settings


Row = tuple[str, str, tuple[int, ...], tuple[int, ...]] | tuple[Any, ...]
"""Grade, name of a problem file, arguments n of its function `mesh`, steps, and optional settings."""


def _list_instances(rows: Sequence[Row], *, of: int = 8, **more: Any) -> tuple[CollectionInstance, ...]:
    return tuple(
        CollectionInstance(grade=grade, problem=problem, n=n, of=of, step=k, settings=settings, **more)
        for grade, problem, cells, steps, *settings_ in rows
        for settings in [tuple(settings_)]
        for n in cells
        for k in steps
    )


SI = "young=2e11", "bound=4e9", "push=8e9", "press=1e7"
TINY = "young=2e-4", "bound=4e-6", "push=8e-6", "press=1e-8"
NEAR_HALF = "poisson=0.499", "poisson=0.49999", "poisson=0.4999999"
PAPER, BLOCK = "feng_han_huang", "block_in_space"
INSTANCES = (
    *_list_instances(
        [
            ("easy", PAPER, (8, 16), (4, 8)),
            ("easy", "frictional_hysteresis", (4, 8), (2,)),
            ("easy", "manufactured_full_slip", (8, 16), (2,)),
            ("sizes", PAPER, (32, 64), (4, 8)),
            ("sizes", PAPER, (128, 256), (8,)),
            ("bounds", "hertz_contact", (6, 12), (2, 8)),
            ("bounds", "block_between_dies", (6, 12), (2,)),
            ("bounds", "beam_on_a_stop", (6,), (2, 8)),
            ("bounds", "spherical_indenter", (6,), (2, 8)),
            ("pressure", "cattaneo_mindlin", (6,), (2, 8)),
            ("pressure", "janssen_silo", (4,), (2, 8)),
            ("pressure", "block_with_grain", (6, 12), (2, 8)),
            ("soft", "rough_layer", (6, 12), (2, 8)),
            ("viscous", "kelvin_voigt_creep", (6,), (2, 5, 8)),
            ("sticking", "shear_lag", (6,), (2, 5, 8)),
            ("sticking", "thermal_expansion_blocked_by_friction", (6,), (2, 5, 8)),
            ("sticking", "l_shaped_bracket", (8, 16), (6, 8)),
            ("bodies", "two_blocks_in_series", (6, 12), (8,)),
            ("bodies", "pack_of_blocks", (6,), (4, 8)),
            ("bodies", "hertz_two_cylinders", (6,), (8,)),
            ("bodies", "press_fit", (6, 12), (8,)),
            ("floating", "block_on_incline", (6, 12), (2,)),
            ("floating", "bolted_joint", (6, 12), (2, 8)),
            ("floating", "brake_pad_on_disc", (6, 12), (2, 8)),
            *(("incompressible", PAPER, (16,), (8,), near) for near in NEAR_HALF),
            *(("units", PAPER, (8, 16), (8,), *units) for units in (SI, TINY)),
            ("discs", BLOCK, (4, 8, 12, 16), (4, 8)),
            ("discs", "circular_hysteresis", (2, 4, 6), (4, 8)),
            ("discs", "block_dragged_along_a_curve", (3, 4), (2, 5, 8)),
            ("discs", "twisted_pad", (4, 6), (2, 8)),
            ("discs", "skew_joint", (4, 6), (2, 8)),
        ]
    ),
    *_list_instances(
        [
            ("sizes", PAPER, (8, 16, 32), (4, 8)),
            ("sizes", PAPER, (64,), (8,)),
            ("bounds", "hertz_contact", (6,), (8,)),
            ("pressure", "block_with_grain", (6,), (8,)),
            ("viscous", "kelvin_voigt_creep", (6,), (8,)),
            *(("incompressible", PAPER, (16,), (8,), near) for near in NEAR_HALF),
            *(("units", PAPER, (8,), (8,), *units) for units in (SI, TINY)),
            ("discs", BLOCK, (4, 8, 12), (8,)),
            ("discs", "circular_hysteresis", (4,), (8,)),
        ],
        condense=False,
    ),
    *_list_instances(
        [
            ("degenerate", "l_shaped_bracket", (8, 16), (6, 8)),
            ("degenerate", PAPER, (16, 32), (6, 8)),
            ("discs", BLOCK, (4, 8), (6, 8)),
        ],
        degenerate=True,
    ),
    *_list_instances(
        [
            ("no optimum", "hertz_contact", (6,), (8,)),
            ("no optimum", "block_with_grain", (6,), (2,)),
            ("no optimum", "spherical_indenter", (6,), (8,)),
        ],
        without=INFEASIBLE,
    ),
    *_list_instances(
        [
            ("no optimum", "block_on_incline", (6,), (2,)),
            ("no optimum", "bolted_joint", (6,), (2,)),
            ("no optimum", "twisted_pad", (4,), (2,)),
        ],
        without=UNBOUNDED,
    ),
)
SEQUENCES = _list_instances(
    [("sequences", name, (n,), (256,)) for name, n in ((PAPER, 32), ("block_with_grain", 6), (BLOCK, 4))],
    of=256,
    steps=256,
)
LARGE = _list_instances([("large", PAPER, (128, 224, 707), (8,)), ("large", BLOCK, (16, 24, 32), (8,))], condense=False)
"""Instances that are written only on request: they take minutes and a gigabyte."""
FEWER = dict.fromkeys(("easy", "soft", "viscous", "units", "incompressible"), 2) | {"discs": 6}


def _choose_core() -> frozenset[str]:
    """Return the names of the core set: a few evenly spaced instances of each grade."""
    found: list[str] = []
    for grade in dict.fromkeys(one.grade for one in INSTANCES):
        own, k = [one.name for one in INSTANCES if one.grade == grade], FEWER.get(grade, 3)
        found += [own[round(i * (len(own) - 1) / (k - 1))] for i in range(k)]
    return frozenset(found)


CORE = _choose_core()


@dataclass(frozen=True, kw_only=True)
class Collection:
    """The command `vemcvx collection`."""

    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder to write to.")] = Path("collection")
    core: Annotated[bool, typer.Option("--core", help="Write only the forty core instances.")] = False
    large: Annotated[bool, typer.Option("--large", help="Add programs of up to a million unknowns.")] = False

    def __call__(self) -> None:
        """Write the graded collection of convex programs, with certified optima and a script that confirms them."""
        # Print no messages about scenes.
        with progress_bar("reading") as show, limit_log(0):
            chosen = tuple(one for one in (*INSTANCES, *SEQUENCES) if one.name in CORE or not self.core)
            more = LARGE if self.large else ()
            say(write_collection(self.out, (*chosen, *more), progress=show))


def write_collection(
    folder: Path,
    instances: Sequence[CollectionInstance] = (*INSTANCES, *SEQUENCES),
    progress: Callable[[str, int, int], None] = lambda *_: None,
) -> str:
    """Write the files of all instances, and return a summary in words."""
    rows = list[dict[str, Any]]()
    with Owned(folder) as files:
        for done, (instance, solved) in enumerate(_make_programs(instances)):
            progress(instance.name, done, len(instances))
            data = _encode(instance, solved)
            for end, content in data.items():
                files.write(f"{instance.name}{end}", content)
            row = {"name": instance.name, "core": instance.name in CORE, **asdict(instance)} | json.loads(data[".json"])
            if optimum := row.get("optimum"):
                error = optimum["energy_error"] + (2 * optimum["rounding_floor"]) ** 0.5
                row["certified"] = error / (optimum["energy_norm"] or 1.0)
            rows.append(row)
        about = {"version": VERSION, "vemcvx": __version__}
        for name in (*TEXTS, SCRIPT):
            text = Path(__file__).with_name(name).read_text(encoding="utf-8")
            files.write(name, text.format(**about) if name in TEXTS else text)
        files.write(MANIFEST, in_json({"collection": VERSION, "vemcvx": __version__, "instances": rows}))
        files.write(OPTIMA, optima(rows).csv())
    sizes = [row["unknowns"] for row in rows]
    return (
        f"{len(rows)} instances of 'vemcvx collection {VERSION}' in {folder}: {min(sizes)} to {max(sizes)} unknowns\n"
        f"{MANIFEST} has sizes, nonzeros and certified optima; python {SCRIPT} confirms these; README.md describes "
        "the files"
    )


SIZES = "unknowns", "norm_terms", "block", "limits", "kernel", "steps"


def optima(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return the table of instances: sizes, status, and bounds on the minimum."""
    cells = []
    for row in rows:
        sizes, optimum = [str(row[name]) for name in SIZES], row.get("optimum", {})
        bounds = [repr(optimum[end]) if optimum else "" for end in ("low", "high")]
        cells.append([row["name"], row["grade"], *sizes, row.get("status", "optimal"), *bounds])
    return Table(("name", "grade", *SIZES, "status", "low", "high"), cells)


def _encode(instance: CollectionInstance, solved: Sequence[SolvedProgram]) -> dict[str, bytes]:
    """Return the files of a program or a sequence, as {suffix: contents}."""
    if instance.steps == 1:
        program, proof = _variant(instance, solved[0])
        files = encode_program(program, "npz")
        return {**files, ".json": in_json({**json.loads(files[".json"]), **proof})}
    # The JSON of a sequence has sums of values, and the largest errors.
    each = [description(program) for program in solved]
    optima = [words["optimum"] for words in each]
    sums = {name: sum(one[name] for one in optima) for name in ("value", "low", "high")}
    most = {name: max(one[name] for one in optima) for name in ("gap", "rounding_floor", "energy_error", "energy_norm")}
    return sequence_to_npz(solved) | {".json": in_json({**each[-1], "steps": len(solved), "optimum": {**sums, **most}})}


def _make_programs(instances: Sequence[CollectionInstance]) -> Iterator[tuple[CollectionInstance, list[SolvedProgram]]]:
    here, exactly = problems_folder(), Newton(accuracy=ACCURACY)
    for _, group in groupby(sorted(instances, key=lambda one: (*one.run, one.name)), key=lambda one: one.run):
        wanted = list(group)
        first, last = wanted[0], max(one.step for one in wanted)
        problem = read_problem(here / f"{first.problem}.py")
        with suppress_scene_warnings():
            posed = problem.pose(first.settings, problem.mesh(first.n), first.of, exactly)
            history = replace(posed, times=posed.times[: last + 1]).simulate(check=False, progress=False)
        for one in wanted:
            numbers = range(one.step - one.steps + 1, one.step + 1)
            yield one, list(programs_of_steps(history, numbers, one.condense))


def _variant(instance: CollectionInstance, program: SolvedProgram) -> tuple[StepProgram, dict[str, Any]]:
    """Return the program of an instance, and a proof if there is no optimum."""
    if instance.degenerate:
        # Lower the weights of sticking terms to the norms of their multipliers.
        size = np.linalg.norm(program.slip(program.answer.d), axis=1)
        lower = np.where(size <= SAME * size.max(initial=0.0), np.linalg.norm(program.answer.lam, axis=1), program.w)
        return replace(program, w=np.minimum(lower, program.w)), {}
    if not instance.without:
        return program, {}
    changed, proof = (_make_infeasible if instance.without == INFEASIBLE else _make_unbounded)(program)
    return changed, {"status": instance.without, "certificate": proof.tolist()}


def _make_infeasible(program: SolvedProgram) -> tuple[StepProgram, Floats]:
    """Return the program with one more limit, which contradicts the first limit, and multipliers as proof.

    The sum of the two limits D_1 d <= e_1 and -D_1 d <= -e_1 - overlap is 0 <= -overlap.
    """
    operators = program.operators
    D = sp.csr_matrix(sp.vstack([operators.D, -operators.D[:1]]))
    overlap = float(np.abs(program.e).max()) or float(np.abs(program.answer.d).max())
    both = replace(operators, D=D, compliance=np.append(operators.compliance, 0.0), given_factor=operators.factor)
    e, p = np.append(program.e, -program.e[0] - overlap), np.zeros(D.shape[0])
    p[[0, -1]] = 1.0
    return StepProgram(both, program.g, program.w, program.b, e), p


def _make_unbounded(program: SolvedProgram) -> tuple[StepProgram, Floats]:
    """Return the program with a larger load g, and a motion r as proof.

    Since K r = 0, D r <= 0 and g'r > sum_i w_i |B_i r|, the objective has no lower bound along r.
    """
    operators = program.operators
    assert operators.kernel is not None
    motions = [sign * motion for motion in operators.kernel.T for sign in (1.0, -1.0)]
    # Motions along an obstacle have D r = 0 up to rounding.
    ray = next(r for r in motions if len(program.e) == 0 or (operators.D @ r).max() <= ROUNDING * np.abs(r).max())
    held = float(program.w @ np.linalg.norm(operators.blocks(operators.B @ ray), axis=1)) or np.abs(program.g).max()
    g = program.g + (2.0 * held - program.g @ ray) / (ray @ ray) * ray
    return StepProgram(operators, g, program.w, program.b, program.e), ray
