"""A collection of instances with certified answers, written for authors of solvers."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import scipy.sparse as sp
import typer

from vemcvx.base.arrays import ROUNDING, SAME, Floats
from vemcvx.base.errors import ProblemError
from vemcvx.base.owned_files import Owned
from vemcvx.base.version import __version__
from vemcvx.cli.collection.instances import (
    CORE,
    COULOMB,
    FCLIB,
    INFEASIBLE,
    INSTANCES,
    LARGE,
    SEQUENCES,
    VERSION,
    Instance,
)
from vemcvx.cli.problem_file import read_problem
from vemcvx.cli.supplied import problems_folder
from vemcvx.cli.terminal import logged_at_most, progress_bar, say
from vemcvx.exchange import FORMATS, description, encoded, in_json, put, sequence_to_npz
from vemcvx.linear import direct_solver
from vemcvx.program.step_program import SolvedProgram, StepProgram
from vemcvx.results.results import programs_of_steps
from vemcvx.results.table import Table
from vemcvx.scene.pose import unwarned
from vemcvx.simulation import programs
from vemcvx.solvers import Newton

MANIFEST, OPTIMA, SCRIPT, SUMS = "manifest.json", "optima.csv", "confirm.py", "SHA256SUMS.txt"
TEXTS = "README.md", "LICENSE.txt", "CITATION.cff"
"""Files beside this one that a collection has with the numbers of its versions put in."""
ACCURACY = 1e-14
"""Asked of optima: as much as there is."""


def write_collection(
    folder: Path,
    beside: str | None = None,
    instances: Sequence[Instance] = (*INSTANCES, *SEQUENCES),
    told: Callable[[str, int, int], None] = lambda *_: None,
) -> str:
    """Make every instance, write a file and its words for each, a manifest and the script; `beside` is a format.

    Returns a summary in words. `told` is called with (name, done, total).
    """
    if beside is not None and beside not in FORMATS:
        raise ProblemError(f"--format: there is no format {beside!r}; there are {', '.join(FORMATS)}.")
    forms = tuple(dict.fromkeys([*([beside] if beside else []), "npz"]))
    rows, written = [], []
    with Owned(folder) as files:

        def place(name: str) -> Path:
            written.append(files.take(name))
            return written[-1]

        for done, (instance, solved) in enumerate(_made(instances)):
            told(instance.name, done, len(instances))
            data = _encoded(instance, solved, forms)
            put({f"{instance.name}{end}": content for end, content in data.items()}, place)
            words = json.loads(data[".json"])
            rows.append({"name": instance.name, "core": instance.name in CORE, **asdict(instance), **words})
        made = {"collection": VERSION, "vemcvx": __version__, "instances": rows}
        about = {"version": VERSION, "vemcvx": __version__}
        beside_this = {name: Path(__file__).with_name(name).read_text(encoding="utf-8") for name in (*TEXTS, SCRIPT)}
        texts = {name: beside_this[name].format(**about) for name in TEXTS} | {SCRIPT: beside_this[SCRIPT]}
        texts |= {MANIFEST: json.dumps(made, indent=1) + "\n", OPTIMA: optima(rows).csv()}
        for name, text in texts.items():
            files.write(place(name).name, text)
        sums = "".join(f"{sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in sorted(written))
        files.write(SUMS, sums)
    sizes = [row["unknowns"] for row in rows]
    others = departures(rows)
    as_published = "" if others else f"; {OPTIMA} agrees with that of version {VERSION}"
    return (
        f"{len(rows)} instances of 'vemcvx collection {VERSION}' in {folder}: {min(sizes)} to {max(sizes)} unknowns\n"
        f"{MANIFEST} has sizes, nonzeros, degenerate terms, conditions, certified optima; python {SCRIPT} confirms "
        f"them; README.md says what the files hold{as_published}"
        + "".join(f"\nOTHER THAN VERSION {VERSION}: {words}" for words in others)
    )


SIZES = "unknowns", "norm_terms", "block", "limits", "kernel", "steps"


def optima(rows: Sequence[Mapping[str, Any]]) -> Table:
    """The sizes of instances, as the manifest has them, and bounds of their optimum, or proof that there is none."""
    cells = []
    for row in rows:
        sizes, optimum = [str(row[name]) for name in SIZES], row.get("optimum", {})
        bounds = [repr(optimum[end]) if optimum else "" for end in ("low", "high")]
        cells.append([row["name"], row["grade"], *sizes, row.get("status", "optimal"), *bounds])
    return Table(("name", "grade", *SIZES, "status", "low", "high"), cells)


def departures(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Sentences on instances that are others than those published with this version, in the list beside this file.

    They are the same if sizes are, and if bounds on the least values overlap but for SAME of them: the last digits of
    condensed matrices and of states before a step are the machine's. Under another BLAS the optimum of a graded mesh
    moved by 1.6e-11, where K did by 2e-12.
    """
    with Path(__file__).with_name(OPTIMA).open(encoding="utf-8", newline="") as file:
        published = {row["name"]: row for row in csv.DictReader(file)}
    found = []
    for row in csv.DictReader(optima(rows).csv().splitlines()):
        name, known = row["name"], published.get(row["name"])
        if known is None:
            found.append(f"{name} is not in it")
            continue
        sizes = [key for key in ("grade", *SIZES, "status") if row[key] != known[key]]
        found += [f"{name} has {key} {row[key]}, not {known[key]}" for key in sizes]
        if row["low"] and known["low"]:
            low, high = (pick(float(row[key]), float(known[key])) for pick, key in ((max, "low"), (min, "high")))
            if low - high > SAME * abs(high):
                found.append(
                    f"the optimum of {name} is at least {row['low']}, at most {row['high']}, not {known['high']}"
                )
    return found


@dataclass(frozen=True, kw_only=True)
class Collection:
    """Write the graded collection of convex programs, with certified optima and a script that confirms them."""

    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder to write to.")] = Path("collection")
    form: Annotated[
        str | None, typer.Option("--format", metavar="mtx|cbf|qps|mps", help="A format to write beside npz.")
    ] = None
    core: Annotated[bool, typer.Option("--core", help="The forty instances of the core set only.")] = False
    large: Annotated[
        bool, typer.Option("--large", help="With sparse programs of up to a million unknowns: minutes, and a GB.")
    ] = False
    fclib: Annotated[
        bool, typer.Option("--fclib", help="With Coulomb's law on 100 to 10,000 contacts, as FCLIB has it: minutes.")
    ] = False

    def __call__(self) -> None:
        """Write it, and say what there is."""
        # What simulations log is about physics that nobody here asks for.
        with progress_bar("reading") as shown, logged_at_most(0):
            chosen = tuple(one for one in (*INSTANCES, *SEQUENCES) if one.name in CORE or not self.core)
            more = (*(LARGE if self.large else ()), *(COULOMB if self.fclib else ()))
            say(write_collection(self.out, self.form, (*chosen, *more), told=shown))


def _encoded(instance: Instance, solved: Sequence[SolvedProgram], forms: Sequence[str]) -> dict[str, bytes]:
    """Contents of files under the ends of their names, of one program or of a sequence; the JSON is the last.

    Of a sequence the value and the bounds on that are sums over all steps, errors those of the worst.
    """
    if instance.steps == 1:
        program, proof = _variant(instance, solved[0])
        files = {end: data for form in forms for end, data in encoded(program, form).items() if data is not None}
        return {**files, ".json": in_json({**json.loads(files[".json"]), **proof})}
    each = [description(program) for program in solved]
    optima = [words["optimum"] for words in each]
    sums = {name: sum(one[name] for one in optima) for name in ("value", "low", "high")}
    most = {name: max(one[name] for one in optima) for name in ("gap", "rounding_floor", "energy_error", "energy_norm")}
    words = {**each[-1], "steps": len(solved), "optimum": {**sums, **most}}
    words["degenerate"] = {name: sum(one["degenerate"][name] for one in each) for name in words["degenerate"]}
    files = sequence_to_npz(solved)
    if instance.grade == FCLIB:
        files = {f"-{one.step}.hdf5": FORMATS["hdf5"][0](one)[".hdf5"] or b"" for one in solved}
    return {**files, ".json": in_json(words)}


def _made(instances: Sequence[Instance]) -> Iterator[tuple[Instance, list[SolvedProgram]]]:
    """The instances with the programs of their steps; those of one run come from one run."""
    here, exactly = problems_folder(), Newton(accuracy=ACCURACY)
    for _, group in groupby(sorted(instances, key=lambda one: (*one.run, one.name)), key=lambda one: one.run):
        wanted = list(group)
        first, last = wanted[0], max(one.step for one in wanted)
        problem = read_problem(here / f"{first.problem}.py")
        with unwarned():  # What holds the bodies is what grades are about.
            posed = problem.posed(first.settings, problem.mesh(first.n), first.of, exactly)
            posed = replace(posed, times=posed.times[: last + 1])
            if first.grade == FCLIB:  # Condensed, K of 10,000 contacts would be 7 GB.
                given: Any = {"condense": False, "linear": direct_solver(posed.mesh.n_nodes), "initial": posed.initial}
                found = programs(posed.scene, posed.mesh, posed.times, solver=exactly, check=False, **given)
                yield first, [one for one in found if one.step > last - first.steps]
                continue
            history = posed.simulated(check=False, progress=False)
        for one in wanted:
            numbers = range(one.step - one.steps + 1, one.step + 1)
            yield one, list(programs_of_steps(history, numbers, one.condense))


def _variant(instance: Instance, program: SolvedProgram) -> tuple[StepProgram, dict[str, Any]]:
    """The program of an instance, and the words that prove that it has no optimum, if it has none."""
    if instance.degenerate:
        # Terms that stick have just the weight that they need: those that slip by less than SAME of the largest slip.
        size = np.linalg.norm(program.slip(program.answer.d), axis=1)
        lower = np.where(size <= SAME * size.max(initial=0.0), np.linalg.norm(program.answer.lam, axis=1), program.w)
        return replace(program, w=np.minimum(lower, program.w)), {}
    if not instance.without:
        return program, {}
    changed, proof = (_pinched if instance.without == INFEASIBLE else _pushed_off)(program)
    return changed, {"status": instance.without, "certificate": proof.tolist()}


def _pinched(program: SolvedProgram) -> tuple[StepProgram, Floats]:
    """The program with a second obstacle opposite the first, which it overlaps, and the multipliers that prove it.

    D_1 d <= e_1 and -D_1 d <= -e_1 - |e|_oo contradict each other: their sum is 0 <= -|e|_oo.
    """
    operators = program.operators
    D = sp.csr_matrix(sp.vstack([operators.D, -operators.D[:1]]))
    overlap = float(np.abs(program.e).max()) or float(np.abs(program.answer.d).max())
    both = replace(operators, D=D, compliance=np.append(operators.compliance, 0.0), given_factor=operators.factor)
    e, p = np.append(program.e, -program.e[0] - overlap), np.zeros(D.shape[0])
    p[[0, -1]] = 1.0
    return StepProgram(both, program.g, program.w, program.b, e), p


def _pushed_off(program: SolvedProgram) -> tuple[StepProgram, Floats]:
    """The program whose load pushes it along a motion of the kernel twice as hard as friction holds it there.

    Along the ray r, K r = 0 and D r <= 0, the objective falls by g'r - sum w_i |B_i r| > 0 for each length of r.
    """
    operators = program.operators
    assert operators.kernel is not None
    motions = [sign * motion for motion in operators.kernel.T for sign in (1.0, -1.0)]
    # A motion along an obstacle does not run into it because of the rounding of its entries.
    ray = next(r for r in motions if len(program.e) == 0 or (operators.D @ r).max() <= ROUNDING * np.abs(r).max())
    held = float(program.w @ np.linalg.norm(operators.blocks(operators.B @ ray), axis=1))
    held = held or float(np.abs(program.g).max())
    g = program.g + (2.0 * held - program.g @ ray) / (ray @ ray) * ray
    return StepProgram(operators, g, program.w, program.b, program.e), ray
