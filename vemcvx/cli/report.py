"""`vemcvx run --report`: a page of HTML that says what was simulated, what came out, how certain it is, and how again.

Pictures and style stand in the page, so that it needs nothing else. It is written when a run has succeeded.
"""

from __future__ import annotations

import base64
import os
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path

import numpy as np

from vemcvx.base.arrays import SAME, Floats
from vemcvx.base.canvas import as_png
from vemcvx.base.errors import ProblemError, VemcvxError
from vemcvx.base.outline import Lines, Outline, coordinates
from vemcvx.base.version import __version__
from vemcvx.cli.doctor import EXTRAS, NEEDED, here, version_of
from vemcvx.cli.problem_file import Problem
from vemcvx.cli.show import scene_in_words
from vemcvx.cli.terminal import write_text
from vemcvx.estimate.budget import error_budget
from vemcvx.estimate.quantities import with_quantities
from vemcvx.history import History
from vemcvx.meshes import PolygonMesh
from vemcvx.plots.pictures import draw_pictures, left_out
from vemcvx.plots.style import WORDS, Units, in_units, unit
from vemcvx.results.files import ENERGIES
from vemcvx.results.table import Table
from vemcvx.scene import Scene

MARK = '<meta name="generator" content="vemcvx">'
"""The mark by which pages of ours are known, so that no other is replaced."""


def page(title: str, body: str, style: str = "") -> str:
    """A page of a title in words and a body of HTML, with style of its own beside what all pages share."""
    head = f'<meta charset="utf-8">{MARK}<meta name="viewport" content="width=device-width">'
    head += f"<title>{escape(title)}</title><style>{_rules('page.css')}{style}</style>"
    foot = f"<p><small>vemcvx {__version__}</small></p>"
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}</head>\n'
        f"<body><h1>{escape(title)}</h1>{body}{foot}</body></html>\n"
    )


def _rules(name: str) -> str:
    """The rules of a style sheet beside this file."""
    return Path(__file__).with_name(name).read_text(encoding="utf-8").replace("\n", "")


REPORT = "report.html"
FORCE, LENGTH, ENERGY = "force", "length", "force × length"
THICKNESS = {2: ", in the plane per unit of thickness", 3: ""}
COLUMNS = {
    "step": "step",
    "time": "t",
    "energy": "stored",
    "dissipated": "dissipated",
    "work": "work",
    "certified": "certified\nrelative",
    "certified_total": "added up\nrelative",
    "iterations": "iterations",
}
REDUCED = {"energy": ENERGY, "energy/length": FORCE, "energy/length²": "force/length"}
"""Energies in tables: products of force and length, reduced."""
PARTS = {
    "algebra": "solving the steps",
    "space": "the mesh",
    "time": "the time steps",
    "total": "all",
    "target": "what was asked for",
}
BUDGETED = 64  # Steps at which a report judges the mesh at most: each takes residuals on all cells.
QUANTITIES = {"dissipated": "dissipated by friction", "work": "work of forces and supports", "wear": "largest wear"}
MEANING = {"bound": "a bound", "for the given friction": "a bound for the given friction"}
CAPTIONS = {
    "deformed_mesh": "The body as it is deformed at the end.",
    "stressed_body": "The stress in the deformed body at the end.",
    "contact_pressure": "Pressure along the contact boundary.",
    "contact_slip": "Slip along the contact boundary.",
    "hysteresis_loop": "The force that the prescribed motion takes.",
    "friction_traction": "Friction along the contact boundary, within its bound.",
    "stick_slip_map": "Which part of the contact boundary sticks and slips when.",
    "wear": "Friction work along the contact boundary, to which wear is in proportion.",
    "deformed_body": "The body as it is deformed at the end, and how it is stressed.",
    "contact_face": "Which part of the face of contact sticks and slips at the end, and where to.",
    "friction_disc": "Friction at the end at every contact node, within the disc of its bound.",
    "error_map": "Where the error of the mesh may be: the parts of cells in its guaranteed bound.",
    "energy_ledger": "Where the work of the forces goes.",
}


def write_report(
    folder: Path,
    problem: Problem,
    history: History,
    settings: Sequence[str],
    mesh: str,
    points: Floats | None,
    command: str,
    why: str = "",
) -> Path:
    """Write the page into the folder of pictures: `command` repeats the run, `mesh` is its mesh in words.

    `why` says why quantities have no estimated errors, if that is so.
    """
    sections = {
        "What was simulated": _prose(problem.text) + _scene(problem.scene(settings), history, mesh),
        "Pictures": "".join(_pictures(history, problem.units)),
        "Results": _results(history, points, problem.units),
        "Certificates": _certificates(history, problem.units),
        "Error budget": _budget(history) + _quantities(history, why, problem.units),
        "The run": _run(history),
        "How to repeat it": _again(problem, settings, command),
    }
    body = f"<p>{history.outline().title}; certified to {history.trajectory.certified.max():.1e} a step.</p>"
    body += "".join(f"<section><h2>{title}</h2>{text}</section>" for title, text in sections.items())
    path = folder / REPORT
    # On narrow screens letters of pictures stay legible: one moves the picture, and not the page.
    write_text(path, page(f"{problem.name}: {problem.title}", body, _rules("report.css")), "--report")
    return path


def check_report(folder: Path) -> None:
    """Refuse a folder in which a file of that name is no page of ours."""
    path = folder / REPORT
    if os.path.lexists(path) and not (path.is_file() and MARK.encode() in path.read_bytes()[:1000]):
        raise ProblemError(f"{path}: not written by vemcvx, so it is not replaced. Choose another folder, or move it.")


def _words(title: str, lines: Lines) -> str:
    """Lines of a name and words, as a table with a title."""
    return f'<div class="wide">{Outline(title, lines).html()}</div>'


def _numbers(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table with heads, which is moved sideways where the page is narrow."""
    return f'<div class="wide">{Table(heads, list(rows)).html()}</div>'


def _prose(text: str) -> str:
    """Paragraphs; those that are indented are formulas or commands, and stay as they are set."""
    parts = [part.strip("\n") for part in text.split("\n\n")]
    kinds = [("pre" if part.startswith(" ") else "p", textwrap.dedent(part)) for part in parts if part.strip()]
    return "".join(f"<{kind}>{escape(said)}</{kind}>" for kind, said in kinds)


def _scene(scene: Scene, history: History, name: str) -> str:
    mesh = history.mesh
    ends = zip(mesh.points.min(axis=0), mesh.points.max(axis=0), strict=True)
    sides = " × ".join(f"[{low:.6g}, {high:.6g}]" for low, high in ends)
    rows = [("body", f"within {sides}; boundaries {', '.join(sorted(mesh.boundaries))}")]
    rows += scene_in_words(scene, mesh, history.trajectory.times, name)
    lines = [(name if k == 0 else "", line) for name, text in rows for k, line in enumerate(text.split("\n"))]
    return _words("The scene, as vemcvx show has it", lines)


def _pictures(history: History, units: Units | None) -> Iterator[str]:
    for name, drawn in draw_pictures(history, units).items():
        data, says = base64.b64encode(as_png(drawn, 130)).decode(), CAPTIONS[name]
        yield f'<figure><img src="data:image/png;base64,{data}" alt="{says}"><figcaption>{says}</figcaption></figure>'
    yield from (f"<p>Left out: {escape(why)}.</p>" for why in dict.fromkeys(left_out(history).values()))


def _results(history: History, points: Floats | None, named: Units | None) -> str:
    run, contact, end = history.trajectory, history.contact, f"t = {history.times[-1]:.6g}"
    axes = "xyz"[: history.mesh.points.shape[1]]
    energies = {
        "stored energy": run.energy,
        "dissipated by friction since the beginning": run.dissipated,
        "work of forces and supports since the beginning": run.work,
        "dissipated, of second order in the steps": run.dissipated_second_order,
        "work, of second order in the steps": run.work_second_order,
    }
    rows = [(words, f"{values[-1]:.6g}", ENERGY) for words, values in energies.items()]
    for one in history.extremes:
        place = f"{one.name}, at {coordinates(one.place)}, t = {one.time:.6g}"
        rows.append((place, f"{one.value:.6g}", one.unit))
    if len(contact.nodes):
        counts = {"stick": contact.stick_count, "slip": contact.slip_count, "are open": contact.open_count}
        said = ", ".join(f"{count[-1]} {name}" for name, count in counts.items())
        rows.append((f"contact nodes at {end}: {said}", str(len(contact.nodes)), ""))
    if points is not None:
        for point, u in zip(points, history.probe(points)[-1], strict=True):
            where = f"at {coordinates(point)}"
            rows += [(f"displacement along {axes[k]}, {where}", f"{x:.6g}", LENGTH) for k, x in enumerate(u)]
    units = (
        "Consistent units, those of the problem's data: the units of force, length and time determine all others"
        f"{THICKNESS[len(axes)]}. Extremes are over the {len(history.stored)} stored of {history.steps + 1} instants; "
        f"displacements of points and reactions are those at {end}."
    )
    rows = [(what, value, _unit(product, named)) for what, value, product in rows]
    told = f"{_numbers(['quantity', 'value', 'unit'], rows)}{_without_limit(history)}<p>{units}</p>"
    forces = {name: history.reaction(name)[-1] for name in history.mesh.boundaries}
    largest = max(float(np.linalg.norm(force)) for force in forces.values())
    # Reactions below this part of the largest are rounding.
    held = {name: force for name, force in forces.items() if np.linalg.norm(force) > SAME * largest}
    if not held:
        return told
    heads = ["boundary", *(f"{axis}\n{in_units(FORCE, named)}" for axis in axes)]
    return (
        f"{told}<p>Reactions, forces on the body from supports, contact and friction. A node that boundaries share "
        "counts in each, and in <i>boundary</i>, all of them; those that are not named carry none.</p>"
        + _numbers(heads, [[name, *(f"{x:.6g}" for x in force)] for name, force in held.items()])
    )


def _without_limit(history: History) -> str:
    """Extremes that grow without limit, and why, those that say the same together."""
    names: dict[str, list[str]] = {}
    for one in history.extremes:
        if one.unbounded:
            names.setdefault(one.unbounded, []).append(one.name)
    told = ((", ".join(some), why) for why, some in names.items())
    return "".join(f"<p>{escape(who[0].upper() + who[1:])}: {escape(why)}.</p>" for who, why in told)


def _certificates(history: History, named: Units | None) -> str:
    """The meaning of certificates, the largest, and those of some steps."""
    run, columns = history.trajectory, history.table("steps")
    bound = (
        "A certificate bounds the distance of an answer from the exact solution of its step in the energy norm, "
        "whatever the solver says: by the duality gap of the step's convex program, ½ |u − u*|² ≤ gap, and with "
        "Coulomb's law of the program whose friction bounds are those of the answer's own pressure and slip. It is "
        "relative to the largest energy norm so far. Steps are certified one by one; the errors of mesh and time steps "
        "are not in it."
    )
    largest = f"{run.certified.max():.1e}, {MEANING[run.certificate_kind]}"
    lines = [
        ("asked for", "-" if run.accuracy is None else f"{run.accuracy:.1e}"),
        ("largest of a step", "; ".join(filter(None, (largest, run.above_asked)))),
        ("all steps added up", f"{run.certified_total.max():.1e}, the largest of the run"),
    ]
    # The table has twelve steps at most; steps.csv has all.
    rows = np.unique(np.linspace(0, history.steps, min(12, history.steps + 1)).round().astype(int))
    body = [[f"{columns[name][row]:{'.1e' if 'certified' in name else '.6g'}}" for name in COLUMNS] for row in rows]
    heads = [f"{head}\n{_unit(ENERGY, named)}" if name in ENERGIES else head for name, head in COLUMNS.items()]
    said = f"<p>{bound}</p>{_words('Relative energy errors', lines)}"
    return said + _numbers(heads, body)


def _budget(history: History) -> str:
    """The error budget, or the reason why there is none."""
    parts, where = history.errors, "the largest of the steps looked at"
    try:
        if not parts:
            budget = error_budget(history, _looked_at(history))
            worst = int(budget.steps[np.argmax(budget.total)])
            parts, where = budget.largest, f"at step {worst}, t = {history.trajectory.times[worst]:.6g}"
            where += f", the largest of {len(budget.steps)} stored steps"
    except VemcvxError as error:
        return f"<p>There is none. {escape(str(error))}</p>"
    rows = [[name, f"{100 * parts[name]:.3g} %", says] for name, says in PARTS.items() if name in parts]
    return (
        f"{_guaranteed(history)}<p>Parts of the largest energy norm of the run, {where}; algebra is certified, the "
        "others are estimated. They are of the instants of the run: what loads do between these is in none of them.</p>"
        f"{_numbers(['part', 'relative energy error', 'from'], rows)}"
    )


def _looked_at(history: History) -> list[int]:
    """The stored steps at which the mesh is judged: all, or BUDGETED of them and that of the largest energy."""
    steps = history.stored[history.stored > 0] if len(history.stored) > 1 else history.stored
    if len(steps) > BUDGETED:
        evenly = steps[np.linspace(0, len(steps) - 1, BUDGETED).round().astype(int)]
        steps = np.union1d(evenly, steps[np.argmax(history.trajectory.norm[steps])])
    return steps.tolist()


def _guaranteed(history: History) -> str:
    """Bounds of the mesh's error in a step, and of the force of a support, where the run was asked for them."""
    if (bound := history.bound) is None:
        return ""
    misread = bound.get("reading", 0.0)
    but = f" and data as read at points, but for {misread:.2g}, an estimate of the rest of them" if misread else ""
    laws = " for the friction that the run's pressure gives" if "friction" in bound.get("kind", "") else ""
    told = (
        f"<p>In every step the error of the mesh, given the step before, is at most {100 * bound['relative']:.3g} % of "
        f"the largest energy norm of the run: {bound['lower']:.4g} to {bound['upper']:.4g} in step "
        f"{bound['step']:.0f}, where it may be largest. This is a theorem{laws}, for any mesh and material"
        f"{but}: no constant was estimated ({bound.get('kind', 'bound')}).</p>"
    )
    if history.force_bounds is None or history.bounded_force is None:
        return told
    ((on, axis),), (low, high) = history.bounded_force.items(), history.force_bounds[-1]
    return told + (
        f"<p>The force of the support on {escape(on)} along x<sub>{axis + 1}</sub>, "
        f"{history.reaction(on)[-1, axis]:.4g} in the last step, is "
        f"between {low:.4g} and {high:.4g} in the exact answer of that step, given the step before, by a theorem "
        "likewise.</p>"
    )


def with_errors(history: History) -> tuple[History, str]:
    """The history with its quantities and their errors, or why it has none."""
    if history.quantities is not None:
        return history, ""
    plane, unknowns = isinstance(history.mesh, PolygonMesh), history.trajectory.state.shape[1]
    # Unasked, as many as an adaptive run has at most; in space, where each costs more, a quarter of that.
    refined, most = (4 * unknowns, 400_000) if plane else (8 * unknowns, 100_000)
    if refined > most:
        return history, f"The refined mesh has some {refined} unknowns; vemcvx.quantities(history) simulates on it."
    try:
        return with_quantities(history)[0], ""
    except VemcvxError as error:
        return history, str(error)


def _unit(product: str, named: Units | None) -> str:
    """The unit of a table, as a product of force and length or by the names that are given."""
    plain = REDUCED.get(product, product)
    return (unit(named, WORDS.get(product, WORDS.get(plain, plain))) if named else plain).replace("/", " / ")


def _quantities(history: History, why: str, named: Units | None) -> str:
    """Friction work, work and wear with their errors, or the reason why there are none."""
    if history.quantities is None:
        return f"<p>Errors of friction work, work and wear are not estimated. {escape(why)}</p>"
    rows = []
    for name, one in history.quantities.items():
        mesh = "-" if np.isnan(one.mesh) else f"{one.mesh:.2g}"
        errors = f"{one.error:.2g}", f"{100 * one.relative:.3g} %", f"{one.steps:.2g}", mesh
        rows.append([QUANTITIES[name], f"{one.value:.6g}", *errors, _unit(one.unit, named)])
    told = [f"<p>Wear: {escape(one.unbounded)}.</p>" for one in history.quantities.values() if one.unbounded]
    head = (
        "<p>Quantities over the whole run, of second order in the steps, with errors that are estimated by the same "
        "run in finer steps, and on the mesh whose cells are all refined.</p>"
    )
    table = _numbers(["quantity", "value", "error", "relative", "of the steps", "of the mesh", "unit"], rows)
    return "".join([head, table, *told])


def _run(history: History) -> str:
    run, mesh = history.trajectory, history.mesh
    kept = int((history.stored > 0).sum())
    lines = [
        ("mesh", f"{mesh.n_cells} cells, {mesh.n_nodes} nodes, largest diameter {mesh.h:.6g}"),
        ("unknowns", f"{run.state.shape[1]}"),
        ("steps", f"{history.steps}, of which {kept} are stored"),
        ("solver", history.solver),
        ("linear solver", run.linear or "-"),
        ("iterations", f"{run.iterations.sum()} in all, {run.safeguards.sum()} of them safeguards"),
        ("seconds", ", ".join(f"{name} {value:.6g}" for name, value in history.seconds.items())),
        ("written", datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")),
        ("vemcvx", here()),
        ("with", ", ".join(f"{name} {found}" for name in (*NEEDED, *EXTRAS) if (found := version_of(name)))),
    ]
    return _words("What was run, when and where", lines)


def _again(problem: Problem, settings: Sequence[str], command: str) -> str:
    """The command, the parameters it leaves as they are, and the problem file."""
    text = problem.path.read_text(encoding="utf-8", errors="replace")
    return (
        f"<p>By this command, with the problem file below:</p><pre>{escape(command)}</pre>"
        + _words("Parameters of the scene", problem.parameters(settings))
        + f"<h3>{escape(problem.path.name)}</h3><pre>{escape(text)}</pre>"
    )
