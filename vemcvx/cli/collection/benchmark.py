"""`vemcvx benchmark`: solvers on a collection, compared at equal true accuracy, whatever their tolerances mean.

Tolerances of two solvers cannot be compared: one bounds a duality gap, another a residual, a third both relative to
norms of its own. So each solver is asked with many (:mod:`vemcvx.cli.collection.trials`), and its time to the error E
on an instance is that of the *cheapest* trial whose true error is at most E. From these times come

- for every E how many instances a solver reaches, and what became of the rest: *missed* (answers, all farther off),
  *failed* (no answer), *late* (out of time); those that it does not take do not count;
- the shifted geometric mean exp(mean log(t + s)) - s of its seconds with s = .01, where an instance that it does not
  reach counts as the time limit, whatever it took;
- the performance profile (Dolan and Moré 2002): the share of instances on which it takes at most x times as long as
  the fastest.

Instances with discs (friction in space) are a table of their own, for not every solver takes their cones; so are those
without an optimum, where a solver is right if it says "infeasible" or "unbounded" as it is. Any other instance
counts at E if its optimum is certified to E/10. How much the comparison owes to a convention is said, too: on how many
instances another solver would be first by certified error, by what solvers claim when they are asked for 1e-6, with
true errors a tenth larger or smaller, or with half of the tolerances.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, fields
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from vemcvx.base.canvas import as_png, legend_below, light_grid, new_figure, plain_logarithms
from vemcvx.base.errors import ProblemError, VemcvxError
from vemcvx.base.owned_files import Owned
from vemcvx.cli.collection.instances import FCLIB
from vemcvx.cli.collection.trials import ASKED, BEGUN, FAILED, REFUSED, STOPPED, WARM, Entrant, Running, Trial, journal
from vemcvx.cli.collection.writing import MANIFEST
from vemcvx.cli.options import NONE, Options, solver_names
from vemcvx.cli.solver_names import read_options
from vemcvx.cli.terminal import listed, progress_bar, say
from vemcvx.plots.style import MARKERS, SERIES
from vemcvx.results.table import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEAN_SHIFT = 0.01
"""Seconds of the shifted geometric mean: differences far below do not count."""
TABLE, WORDS, PROFILES, MEANS = "trials.csv", "benchmark.md", "profiles.png", "means.png"
PLANE, DISCS, NONE_THERE, COLD, WARM_START = "plane", "discs", "no optimum", "cold", "warm"
KINDS = {
    PLANE: "Absolute values and bounds",
    DISCS: "Discs: second-order cones",
    NONE_THERE: "Infeasible or unbounded",
    COLD: "Sequences of steps, each begun cold",
    WARM_START: "Sequences of steps, each begun with what the one before has left",
}
"""Kinds of instances, and how tables call them."""
BATCH = 10
"""Instances that a process tries, between two words of how far it is; starting it takes a second."""
USUAL_TOLERANCES = ",".join(f"1e-{k}" for k in range(1, 16))


@dataclass(frozen=True, kw_only=True)
class Benchmark:
    """Compare solvers on a collection at equal true accuracy: a sweep of tolerances, a table, profiles, means."""

    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that `vemcvx collection` wrote.")]
    solvers: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            autocompletion=solver_names,
            help="Names of solvers, or FILE.py:CLASS for your own. (default: none, the table of what is stored)",
        ),
    ] = None
    time_limit: Annotated[float, typer.Option(metavar="SECONDS", help="Of a solver for one trial.")] = 60.0
    tolerances: Annotated[
        str, typer.Option(metavar="X,X,...", help="What solvers are asked with.", show_default="1e-1,1e-2,...,1e-15")
    ] = USUAL_TOLERANCES
    options: Options = NONE
    only: Annotated[
        str | None, typer.Option(metavar="WORD,WORD,...", help="Instances whose grade or name has one of these words.")
    ] = None
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Results. (default: benchmark, in the folder)")] = None

    def __call__(self) -> None:
        """Try what is not tried yet, write tables and pictures of all that is stored, and print the tables."""
        if not self.time_limit > 0:
            raise ProblemError(f"--time-limit: found {self.time_limit:g}; wanted seconds, more than zero.")
        instances = read_instances(self.folder, self.only)
        tolerances = listed("--tolerances", self.tolerances, float, "numbers such as 1e-3,1e-6,1e-9")
        if not all(0 < one < 1 for one in tolerances):
            raise ProblemError(f"--tolerances: found {self.tolerances}; wanted numbers between 0 and 1.")
        out = self.out or self.folder / "benchmark"
        with Owned(out) as files:
            for entrant in self.entrants():
                kept = re.sub(r"[^\w.=+ -]+", "_", f"{entrant.name} {entrant.version}").replace(" ", "_")
                running = Running(self.folder, entrant, self.time_limit, files.take(f"{kept}.jsonl"))
                work = [(one.name, one.digest, entrant.ladder(tolerances)) for one in instances]
                with progress_bar(entrant.name) as shown:
                    for done in range(0, len(work), BATCH):
                        shown(entrant.name, done, len(work))
                        running.try_all(work[done : done + BATCH])
            entries = stored(out, instances)
            if not entries:
                raise ProblemError(f"{out}: no results are stored there; name solvers by --solvers.")
            text, markdown = in_words(entries, instances, self.time_limit)
            heads = ("solver", *(field.name for field in fields(Trial)))
            tried = [(label, *astuple(one)) for label, own in entries.items() for some in own.values() for one in some]
            files.write(TABLE, Table(heads, tried).csv())
            files.write(WORDS, markdown)
            say(text)
            try:
                files.write(PROFILES, as_png(profiles(entries, instances), 150))
                files.write(MEANS, as_png(means(entries, instances, self.time_limit), 150))
            except VemcvxError as error:
                say(f"No pictures: {error}.")
        say(f"\n{out} has every trial ({TABLE}), the tables ({WORDS}) and pictures ({PROFILES}, {MEANS})")

    def entrants(self) -> list[Entrant]:
        """The solvers asked for, with the settings of their libraries."""
        if self.solvers is None:
            return []
        names = listed("--solvers", self.solvers, str, "names such as clarabel,scs,mine.py:Mine")
        options = read_options(self.options, names)
        entrants = [Entrant(name, tuple(options.get(name, {}).items())) for name in dict.fromkeys(names)]
        # A name that there is not is an error here, and not in every trial.
        for entrant in entrants:
            entrant.solver.check_accuracy()
        return entrants


@dataclass(frozen=True)
class Listed:
    """An instance, as the manifest and its file have it; `certified` is the relative error of its optimum."""

    name: str
    digest: str
    kind: str
    certified: float = 0.0


def read_instances(folder: Path, only: str | None) -> list[Listed]:
    """The instances of a collection, or those whose grade or name has one of the words."""
    path = folder / MANIFEST
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))["instances"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ProblemError(
            f"{folder}: has no {MANIFEST} of a collection ({error}); write one by vemcvx collection --out {folder}."
        ) from error
    words = () if only is None else listed("--only", only, str, "words such as core,discs,degenerate")
    found = [
        one
        for row in rows
        if row["grade"] != FCLIB
        if not words or any(w == row["grade"] or w in row["name"] or (w == "core" and row.get("core")) for w in words)
        for one in _listed(folder, row)
    ]
    if not found:
        grades = ", ".join(sorted({row["grade"] for row in rows}))
        raise ProblemError(f"--only: no grade or name has {only!r}; the grades are {grades}.")
    return found


def _listed(folder: Path, row: Mapping[str, Any]) -> list[Listed]:
    """An instance; of a sequence there are two, one cold and one warm."""
    digest = sha256((folder / f"{row['name']}.npz").read_bytes()).hexdigest()[:12]
    if "optimum" not in row:
        return [Listed(row["name"], digest, NONE_THERE)]
    optimum = row["optimum"]
    error = optimum["energy_error"] + (2 * optimum["rounding_floor"]) ** 0.5
    certified = error / (optimum["energy_norm"] or 1.0)
    if row.get("steps", 1) > 1:
        return [Listed(row["name"], digest, COLD, certified), Listed(row["name"] + WARM, digest, WARM_START, certified)]
    return [Listed(row["name"], digest, DISCS if row["block"] > 1 else PLANE, certified)]


Entries = Mapping[str, Mapping[str, Sequence[Trial]]]
"""The label of a solver -> the name of an instance -> its trials, but those that began only."""


def stored(folder: Path, instances: Sequence[Listed]) -> Entries:
    """All journals in a folder, whoever made them; trials of other files than these instances' do not count."""
    digests = {one.name: one.digest for one in instances}
    found: dict[str, dict[str, list[Trial]]] = {}
    for path in sorted(folder.glob("*.jsonl")):
        own: dict[str, list[Trial]] = {}
        for trial in journal(path):
            if trial.outcome != BEGUN and digests.get(trial.instance) == trial.digest:
                own.setdefault(trial.instance, []).append(trial)
        if own:
            found[path.stem.replace("_", " ")] = own
    return found


# Scores.


def seconds_to(trials: Iterable[Trial], error: float, measure: str = "true") -> float:
    """The seconds of the cheapest trial that reaches the error; infinite if none does."""
    known = [(one.seconds, getattr(one, measure)) for one in trials if one.seconds is not None]
    return min((seconds for seconds, reached in known if reached is not None and reached <= error), default=np.inf)


def takes(own: Mapping[str, Sequence[Trial]], name: str) -> bool:
    """Return True if a solver was tried on an instance, and takes it."""
    return name in own and all(one.outcome != REFUSED for one in own[name])


def taking(entries: Entries, names: Sequence[str]) -> Entries:
    """The solvers that take some of the instances."""
    return {label: own for label, own in entries.items() if any(takes(own, name) for name in names)}


def fate(trials: Sequence[Trial], error: float) -> str:
    """The fate of an instance at an error: "reached", "missed", FAILED or STOPPED."""
    if np.isfinite(seconds_to(trials, error)):
        return "reached"
    outcomes = [one.outcome for one in trials]
    return next((one for one in (STOPPED, FAILED) if one in outcomes), "missed")


def counted(instances: Sequence[Listed], error: float, kind: str) -> list[str]:
    """The instances of a kind whose optimum is certified to a tenth of the error."""
    return [one.name for one in instances if one.kind == kind and one.certified <= 0.1 * error]


def shifted_mean(seconds: Sequence[float], limit: float) -> float:
    """The shifted geometric mean, in which what is not reached counts as the limit; NaN of none."""
    if not seconds:
        return float("nan")
    capped = np.minimum(np.asarray(seconds, dtype=float), limit)
    return float(np.exp(np.log(capped + MEAN_SHIFT).mean()) - MEAN_SHIFT)


def profile(entries: Entries, names: Sequence[str], error: float) -> dict[str, list[float]]:
    """label -> on each instance, seconds over those of the fastest; infinite where it is not reached."""
    times = {label: [seconds_to(own.get(name, ()), error) for name in names] for label, own in entries.items()}
    # A clock that ticks slowly may count nothing at all.
    tick = time.get_clock_info("process_time").resolution
    times = {label: [max(t, tick) for t in own] for label, own in times.items()}
    best = [min(column) for column in zip(*times.values(), strict=True)]
    return {
        label: [t / fastest if np.isfinite(t) else np.inf for t, fastest in zip(own, best, strict=True)]
        for label, own in times.items()
    }


CLAIMED = ASKED[1]
"""The tolerance at which claims of solvers are looked at."""


def first(entries: Entries, name: str, by: str, error: float = CLAIMED) -> str | None:
    """The fastest solver to an error on an instance: by "true" error, by "certified" error, or by "claim"."""
    times = {}
    for label, own in entries.items():
        trials = own.get(name, ())
        if by == "claim":
            asked = [one for one in trials if one.tolerance in (None, CLAIMED)]
            claims = [one for one in asked if not re.search("inacc|limit", one.says)]
            times[label] = seconds_to(claims, np.inf)
        else:
            times[label] = seconds_to(trials, error, by)
    best = min(times, key=lambda label: times[label], default=None)
    return best if best is not None and np.isfinite(times[best]) else None


# The scores as text, Markdown and pictures.


def in_words(entries: Entries, instances: Sequence[Listed], limit: float) -> tuple[str, str]:
    """A table for each kind of instances, and what it owes to conventions, as text for a terminal and as Markdown."""
    text, markdown = "", "# Solvers at equal true accuracy\n\n"
    for kind, title in KINDS.items():
        names = [one.name for one in instances if one.kind == kind]
        if not (some := taking(entries, names)):
            continue
        tried = [name for name in counted(instances, CLAIMED, kind) if any(name in own for own in some.values())]
        said = "" if kind == NONE_THERE else conventions(some, tried)
        heading, table = f"{title}: {len(names)} instances", scores(some, instances, kind, limit)
        text += f"{heading}\n{table.text()}\n\n{said}\n\n"
        markdown += f"## {heading}\n\n{table.markdown()}\n{said}\n\n"
    remark = (
        "Instances reached, of those that the solver takes and whose optimum is certified to a tenth of the error; and "
        "seconds of the processor to that error by the cheapest tolerance: shifted geometric means over the instances "
        f"that all solvers of the table take, with {limit:g} s where one is not reached. sure: reached by certified "
        f"error, too (which includes what rounding hides); miss, fail, late: fates of the others at {CLAIMED:g}; not: "
        "instances that the solver does not take; lost: seconds of those that are not reached. A status, infeasible or "
        "unbounded, is right or wrong, whatever the error."
    )
    return f"{text}{remark}", f"{markdown}{remark}\n"


def scores(entries: Entries, instances: Sequence[Listed], kind: str, limit: float) -> Table:
    """A row a solver, the fastest to 1e-6 first; means are over the instances that all these solvers take."""
    rows, names = [], {error: counted(instances, error, kind) for error in ASKED}
    for label, own in entries.items():
        at = {error: [name for name in names[error] if takes(own, name)] for error in ASKED}
        refused = sum(name in own and not takes(own, name) for name in names[max(ASKED)])
        reached = [f"{sum(fate(own[name], e) == 'reached' for name in at[e])}/{len(at[e])}" for e in ASKED]
        sure = sum(np.isfinite(seconds_to(own[name], CLAIMED, "certified")) for name in at[CLAIMED])
        fates = {name: fate(own[name], CLAIMED) for name in at[CLAIMED]}
        ends = [list(fates.values()).count(one) for one in ("missed", FAILED, STOPPED)]
        missed = [one for name, end in fates.items() if end != "reached" for one in own[name]]
        # Trials that are out of time took their limit.
        lost = sum(one.limit if one.outcome == STOPPED else one.seconds or 0.0 for one in missed)
        mean = [mean_seconds(own, common(entries, names[error]), error, limit) for error in ASKED]
        means = ["-" if np.isnan(m) else f"{m:.2g}".removeprefix("0") for m in mean]
        rows.append((mean[1], [label, *reached, *map(str, (sure, *ends, refused)), *means, f"{lost:.0f}"]))
    errors = [f"1e{round(np.log10(error))}" for error in ASKED]
    counts = (*(f"to\n{error}" for error in errors), f"sure\n{errors[1]}", "miss", "fail", "late", "not")
    heads = ("solver", *counts, *(f"s to\n{error}" for error in errors), "lost\ns")
    return Table(heads, [cells for _, cells in sorted(rows, key=lambda row: row[0])])


def common(entries: Entries, names: Sequence[str]) -> list[str]:
    """The instances that all solvers were tried on and take."""
    return [name for name in names if all(takes(own, name) for own in entries.values())]


def mean_seconds(own: Mapping[str, Sequence[Trial]], names: Sequence[str], error: float, limit: float) -> float:
    """The shifted geometric mean of a solver's seconds to an error on these instances."""
    return shifted_mean([seconds_to(own[name], error) for name in names], limit)


def conventions(entries: Entries, names: Sequence[str]) -> str:
    """Sentences on the instances whose first place another measure, or another sweep, would give to another solver."""
    fewer, by_true = every_other(entries), {name: first(entries, name, "true") for name in names}
    certified, claim, sparse = (
        sum(first(some, name, by) != best for name, best in by_true.items())
        for some, by in ((entries, "certified"), (entries, "claim"), (fewer, "true"))
    )
    near = sum(
        any(first(entries, name, "true", x * CLAIMED) != best for x in (0.9, 1.1)) for name, best in by_true.items()
    )
    return (
        f"Of {len(names)} instances the fastest to {CLAIMED:g} is another solver on {certified} if certified errors "
        f"count in place of true ones, and on {claim} if claims do: answers called optimal at tolerance {CLAIMED:g}. "
        f"It is another on {near} if true errors are a tenth larger or smaller, which is as much as optima leave open, "
        f"and on {sparse} if every other tolerance is left out."
    )


def every_other(entries: Entries) -> Entries:
    """The trials at every other tolerance that each solver was asked with, the loosest among them."""
    kept = {}
    for label, own in entries.items():
        tried = sorted({one.tolerance for some in own.values() for one in some if one.tolerance is not None})
        asked = {None, *tried[::-2]}
        kept[label] = {name: [one for one in some if one.tolerance in asked] for name, some in own.items()}
    return kept


def profiles(entries: Entries, instances: Sequence[Listed]) -> Figure:
    """Performance profiles at each error, a row for each kind of instances, over those that all solvers of it take."""
    rows = [kind for kind in (PLANE, DISCS) if shared(entries, instances, CLAIMED, kind)[1]]
    if not rows:
        raise VemcvxError("no instance was tried by all solvers that take some")
    figure = new_figure(11.0, 0.8 + 3.4 * len(rows))
    grid = figure.subplots(len(rows), len(ASKED), sharex=True, sharey=True, squeeze=False)
    for axes, kind in zip(grid, rows, strict=True):
        for ax, error in zip(axes, ASKED, strict=True):
            some, names = shared(entries, instances, error, kind)
            title = f"{kind}, true error {error:.0e}"
            if names:
                _steps(ax, list(entries), profile(some, names, error))
                title = f"{title}: {len(names)} instances"
            ax.set(xscale="log", xlim=(1.0, 1e4), ylim=(0.0, 1.02))
            ax.set_title(title, fontsize="medium")
            plain_logarithms(ax.xaxis, (1.0,))
            light_grid(ax)
        axes[0].set_ylabel("share of instances")
    grid[-1][1].set_xlabel("times as long as the fastest")
    figure.legend(*grid[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False)
    return figure


def _steps(ax: Axes, labels: Sequence[str], ratios: Mapping[str, Sequence[float]]) -> None:
    """Draw a profile; colours are those of a label's place among all."""
    for label, own in ratios.items():
        x = np.concatenate([[1.0], np.sort([one for one in own if np.isfinite(one)]), [1e9]])
        share = np.arange(len(x)) / max(len(own), 1)
        share[-1] = share[-2]
        again, place = divmod(labels.index(label), len(SERIES))
        ax.step(
            x, share, ("-", "--", ":", "-.")[again % 4], color=SERIES[place], where="post", label=label, linewidth=1.6
        )


def means(entries: Entries, instances: Sequence[Listed], limit: float) -> Figure:
    """The shifted geometric means to each error, a panel for each kind of instances, the fastest to 1e-6 above."""
    kinds = [kind for kind in (PLANE, DISCS) if shared(entries, instances, CLAIMED, kind)[1]]
    figure = new_figure(5.6 * len(kinds), 1.8 + 0.3 * len(entries))
    for ax, kind in zip(figure.subplots(1, len(kinds), squeeze=False)[0], kinds, strict=True):
        found: dict[str, list[float]] = {}
        for error in ASKED:
            some, names = shared(entries, instances, error, kind)
            for label, own in some.items() if names else ():
                found.setdefault(label, []).append(mean_seconds(own, names, error, limit))
        labels = sorted(found, key=lambda label: -found[label][1])
        for k, (error, marker) in enumerate(zip(ASKED, MARKERS, strict=False)):
            values = [found[label][k] for label in labels]
            ax.plot(values, range(len(labels)), marker, color=SERIES[k], label=f"true error {error:.0e}")
        ax.set_yticks(range(len(labels)), labels)
        ax.set(xscale="log", title=kind, xlabel=f"shifted geometric mean of seconds ({limit:g} where not reached)")
        light_grid(ax)
        legend_below(ax)
    return figure


def shared(entries: Entries, instances: Sequence[Listed], error: float, kind: str) -> tuple[Entries, list[str]]:
    """The solvers that take some instances of a kind, and the instances that count and that all of these take."""
    names = counted(instances, error, kind)
    some = taking(entries, names)
    return some, common(some, names) if some else []
