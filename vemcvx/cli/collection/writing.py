"""A collection of instances with certified answers, written for authors of solvers."""

from __future__ import annotations

import csv
import json
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import scipy.sparse as sp
import typer

from vemcvx.arrays import ROUNDING, SAME, Floats
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
from vemcvx.errors import ProblemError, SceneWarning
from vemcvx.exchange import FORMATS, description, encoded, in_json, put, sequence_to_npz
from vemcvx.linear import direct_solver
from vemcvx.outline import Table
from vemcvx.owned_files import ANY_KIND, Owned
from vemcvx.program.step_program import SolvedProgram, StepProgram
from vemcvx.results.results import programs_of_steps
from vemcvx.simulation import programs, simulate
from vemcvx.solvers import Newton
from vemcvx.version import __version__

MANIFEST, OPTIMA, SCRIPT, SUMS = "manifest.json", "optima.csv", "confirm.py", "SHA256SUMS.txt"
KINDS = rf"README\.md|LICENSE\.txt|CITATION\.cff|SHA256SUMS\.txt|{ANY_KIND}"
"""Names of the files that a collection may have."""
README = """# A collection of convex programs from frictional contact, with certified optima

Version {version}, written by vemcvx {vemcvx}. Each instance is one step of a quasistatic problem with friction,

    minimise 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i|  subject to  D d <= e,

where a limit with a compliance c_j > 0 has (D_j d - e_j)_+^2 / (2 c_j) in place of its bound. B_i d is a number in the
plane, a vector of two components in space. At the solution K d = g - B'lam - D'p, |lam_i| <= w_i, p >= 0.

| file | what it holds |
|---|---|
| `NAME.npz` | K, B, D, g, w, b, e, c as NumPy arrays, and the answer d, lam, p |
| `NAME-1toNofN.npz` | a sequence: g, w, b, e, d, lam, p have a row a step, K, B, D, c are those of all steps |
| `NAME-1toNofN-k.hdf5` | a step with Coulomb's law itself and its solution, as FCLIB has it (of the grade "fclib") |
| `NAME.json` | origin, sizes, condition of K, degenerate terms, the certified optimum with bounds on it |
| `manifest.json` | the same of all instances in one file, with their grades, and which are of the core set |
| `optima.csv` | name, sizes, and bounds on the least value, a line each: what two versions are compared by |
| `confirm.py` | solves all by Clarabel and HiGHS, and confirms every optimum |
| `SHA256SUMS.txt` | `sha256sum -c SHA256SUMS.txt` |

Sparse arrays are compressed rows, `B_data, B_indices, B_indptr, B_shape`. `confirm.py` needs numpy, scipy, clarabel and
highspy only, and h5py for what is FCLIB's.

With the answer d* of the file, the *true error* of yours is |d - d*|_K / |d*|_K; d* itself is certified to the error
that the JSON names, `optimum.energy_error` over `optimum.energy_norm`, by the duality gap. Instances of the grade "no
optimum" have in place of an answer a vector `certificate`: of an infeasible one p >= 0 with D'p = 0 and e'p < 0; of an
unbounded one a ray d with K d = 0, D d <= 0 and g'd > sum_i w_i |B_i d|.

Sequences are for warm starts: 256 programs, the steps of a run, of which each is posed from the certified answer to the
one before, so that errors of a solver do not add up. Their error is the largest of all steps, |d_k - d_k*|_K over the
largest |d_k*|_K; their JSON has that of the worst step, and of values and bounds the sums.

Instances of the grade "fclib" are for solvers of Coulomb's law, M v = H r + f, u = H'v + w, r in the cones of mu: r_N
>= 0, u_N >= 0, r_N u_N = 0, |r_T| <= mu r_N, r_T against u_T. No convex program is equivalent to them. The file's
description says what the solution is certified to, as the answer to the convex program with the weights mu r_N, whose
values `optima.csv` has; `confirm.py` puts it into every line of the law, with h5py.

## Your solver in ten minutes

`pip install "vemcvx[plot]"`, or `pip install ".[plot]"` in a checkout, and in this folder a file `mine.py`:

    import numpy as np

    class Mine:
        def solve(self, program, target):
            operators = program.operators  # K is dense or sparse, B and D are sparse; block is 1, or 2 for discs
            K, B, D, c, block = operators.K, operators.B, operators.D, operators.compliance, operators.block
            g, w, b, e = program.g, program.w, program.b, program.e
            ...  # d (n,), lam (m, block), p (r,); program.project(lam) and program.feasible(d) are within the bounds
            ...  # solve it to a duality gap of `target`, program.duality_gap(d, lam, p) says how far it is
            return d, lam, p, iterations  # or (d, lam, p), or d alone: multipliers are recovered

    vemcvx benchmark . --solvers mine.py:Mine,newton,scs --only core --time-limit 2 --tolerances 1e-3,1e-6,1e-9,1e-12

sweeps the tolerances of all of them, takes for every solver and instance the cheapest that reaches a true error of
1e-3, 1e-6 and 1e-9, and writes a table, performance profiles and means into `benchmark/`. That is a first look, of a
minute or two of a processor; for a table to publish leave out `--only core` and `--tolerances`, and give every trial
10 s or more. Results are stored a solver and version, of a file a version for each of its contents; the command goes on
where it was stopped, and shows what others have stored there, too.

K is definite as your solver sees it: bodies that float are made so by proximal terms, unless the class says
`semidefinite = True`. A solver that finds a program infeasible or unbounded says so by
`return vemcvx.Answer(d, lam, iterations, status="infeasible")`. Sequences are tried twice, each step cold and each step
warm: `def solve(self, program, target, lam, p)` is given the multipliers that it returned for the step before, zeros
where it begins cold.

Licence: BSD Zero Clause (LICENSE.txt): do with it what you like. To cite it: CITATION.cff.
"""
LICENCE = """BSD Zero Clause License

Copyright (C) 2026 the vemcvx authors

Permission to use, copy, modify, and/or distribute this software for any purpose with or without fee is hereby granted.

THE SOFTWARE IS PROVIDED "AS IS" AND THE AUTHOR DISCLAIMS ALL WARRANTIES WITH REGARD TO THIS SOFTWARE INCLUDING ALL
IMPLIED WARRANTIES OF MERCHANTABILITY AND FITNESS. IN NO EVENT SHALL THE AUTHOR BE LIABLE FOR ANY SPECIAL, DIRECT,
INDIRECT, OR CONSEQUENTIAL DAMAGES OR ANY DAMAGES WHATSOEVER RESULTING FROM LOSS OF USE, DATA OR PROFITS, WHETHER IN AN
ACTION OF CONTRACT, NEGLIGENCE OR OTHER TORTIOUS ACTION, ARISING OUT OF OR IN CONNECTION WITH THE USE OR PERFORMANCE OF
THIS SOFTWARE.
"""
CITATION = """cff-version: 1.2.0
message: "If you use this collection, please cite it."
title: "Convex programs from frictional contact with certified optima, version {version}"
type: dataset
version: {version}
license: 0BSD
authors:
  - name: "The vemcvx authors"
abstract: "Steps of problems with frictional contact, as convex programs, and with Coulomb's law as FCLIB has it."
keywords: [convex optimisation, second-order cones, frictional contact, virtual elements, benchmark]
"""
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
    with Owned(folder, KINDS) as files:

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
        place(MANIFEST).write_text(json.dumps(made, indent=1) + "\n")
        place(OPTIMA).write_text(optima(rows).csv())
        place(SCRIPT).write_text(Path(__file__).with_name(SCRIPT).read_text())
        place("README.md").write_text(README.format(**about))
        place("LICENSE.txt").write_text(LICENCE)
        place("CITATION.cff").write_text(CITATION.format(**about))
        sums = "".join(f"{sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in sorted(written))
        files.take(SUMS).write_text(sums)
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
    """Of instances, as the manifest has them: sizes, and between what numbers the least value is, or that none is."""
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
    here = problems_folder()
    for _, group in groupby(sorted(instances, key=lambda one: (*one.run, one.name)), key=lambda one: one.run):
        wanted = list(group)
        first, last = wanted[0], max(one.step for one in wanted)
        problem = read_problem(here / f"{first.problem}.py")
        with warnings.catch_warnings():
            # What holds the bodies is what grades are about.
            warnings.simplefilter("ignore", SceneWarning)
            scene, mesh, initial = problem.scene(first.settings), problem.mesh(first.n), problem.initial
            times, exactly = np.asarray(problem.times(first.of))[: last + 1], Newton(accuracy=ACCURACY)
            if first.grade == FCLIB:  # Condensed, K of 10,000 contacts would be 7 GB.
                given: Any = {"condense": False, "linear": direct_solver(mesh.n_nodes)}
                found = programs(scene, mesh, times, solver=exactly, initial=initial, check=False, **given)
                yield first, [one for one in found if one.step > last - first.steps]
                continue
            history = simulate(scene, mesh, times, solver=exactly, initial=initial, check=False, progress=False)
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
