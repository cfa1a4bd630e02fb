"""vemcvx run --report: a page of HTML that says what was simulated, what came out, and how certain it is."""

from __future__ import annotations

import base64
import os
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.canvas import as_png
from vemcvx.cli.doctor import EXTRAS, NEEDED, here, version_of
from vemcvx.cli.problem_file import Problem
from vemcvx.cli.run_options import RunOptions
from vemcvx.cli.show import mesh_name, scene_in_words
from vemcvx.errors import ProblemError, VemcvxError
from vemcvx.estimate.budget import error_budget
from vemcvx.history import WHY_ESTIMATED, History
from vemcvx.outline import Lines, Outline, coordinates
from vemcvx.outline import html as table
from vemcvx.plots.pictures import draw_pictures, left_out
from vemcvx.version import __version__

# Pages of HTML that need nothing else: their style stands in them, their pictures, too.


MARK = '<meta name="generator" content="vemcvx">'
"""By which pages of ours are known."""
STYLE = (
    "body{font:15px/1.4 sans-serif;margin:2em auto;padding:0 1em;max-width:75em}"
    "table{border-collapse:collapse;margin:1em 0}"
    "th,td{padding:.2em .7em;text-align:right;border-bottom:1px solid #ccc}th{vertical-align:bottom}"
    ".w{text-align:left}small{font-weight:normal;color:#666}.no{color:#b00}"
)


def page(title: str, body: str, style: str = "") -> str:
    """A page of a title in words and a body of HTML, with style of its own beside what all pages share."""
    head = f'<meta charset="utf-8">{MARK}<meta name="viewport" content="width=device-width">'
    head += f"<title>{escape(title)}</title><style>{STYLE}{style}</style>"
    foot = f"<p><small>vemcvx {__version__}</small></p>"
    return (
        f'<!doctype html>\n<html lang="en"><head>{head}</head>\n'
        f"<body><h1>{escape(title)}</h1>{body}{foot}</body></html>\n"
    )


def words(title: str, lines: Lines) -> str:
    """Lines of a name and words, as a table with a title."""
    return f'<div class="wide">{Outline(title, lines).html()}</div>'


def numbers(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table with heads, which is moved sideways where the page is narrow."""
    return f'<div class="wide">{table(heads, rows)}</div>'


def figure(value: float) -> str:
    """A number in six digits."""
    return f"{value:.6g}"


def short(value: float) -> str:
    """An error in two digits."""
    return f"{value:.1e}"


# What came out of a run, as parts of its report: results with their units, certificates, the budget of errors.


FORCE, LENGTH, ENERGY = "force", "length", "force × length"
THICKNESS = {2: ", in the plane per unit of thickness", 3: ""}
COLUMNS = {
    "step": ("step", ""),
    "time": ("t", ""),
    "energy": ("stored", ENERGY),
    "dissipated": ("dissipated", ENERGY),
    "work": ("work", ENERGY),
    "certified": ("certified", "relative"),
    "certified_total": ("added up", "relative"),
    "iterations": ("iterations", ""),
}
PARTS = {
    "algebra": "solving the steps",
    "space": "the mesh",
    "time": "the time steps",
    "total": "all",
    "target": "what was asked for",
}
MEANING = {"bound": "a bound", "estimate": "an estimate"}


def results(history: History, points: Floats | None) -> str:
    """Energies, extremes over the stored steps, displacements of points at the last one, and reactions."""
    run, t = history.trajectory, history.times[-1]
    rows = [
        ("stored energy", figure(run.energy[-1]), ENERGY),
        ("dissipated by friction since the beginning", figure(run.dissipated[-1]), ENERGY),
        ("work of forces and supports since the beginning", figure(run.work[-1]), ENERGY),
        *_extremes(history),
    ]
    units = (
        "Consistent units, those of the problem's data: the unit of force and the unit of length say all others"
        f"{THICKNESS[history.mesh.points.shape[1]]}. Extremes are over the {len(history.stored)} stored of "
        f"{history.steps + 1} instants; displacements of points and reactions are those at t = "
    )
    forces = {name: history.reaction(name)[-1] for name in history.mesh.boundaries}
    largest = max(float(np.linalg.norm(force)) for force in forces.values())
    # Reactions below this part of the largest are rounding.
    held = [(name, force) for name, force in forces.items() if np.linalg.norm(force) > 1e-9 * largest]
    axes = [f"{axis}\n{FORCE}" for axis in "xyz"[: history.mesh.points.shape[1]]]
    table = numbers(["boundary", *axes], [[name, *map(figure, force)] for name, force in held])
    reactions = (
        "<p>Reactions, forces on the body from supports, contact and friction. A node that boundaries share counts in "
        "each, and in <i>boundary</i>, all of them; those that are not named carry none.</p>"
    )
    if points is not None:
        rows += _moved(points, history.probe(points)[-1])
    told = f"{numbers(['quantity', 'value', 'unit'], rows)}<p>{units}{t:.6g}.</p>"
    return told + f"{reactions}{table}" * bool(held)


def _moved(points: Floats, displacements: Floats) -> list[tuple[str, str, str]]:
    """Displacements of points, component by component."""
    return [
        (f"displacement along {axis}, at {coordinates(point)}", figure(u[k]), LENGTH)
        for point, u in zip(points, displacements, strict=True)
        for k, axis in enumerate("xyz"[: len(u)])
    ]


def _extremes(history: History) -> Iterator[tuple[str, str, str]]:
    """Extremes over the history, with where and when they are; then the nodes of contact at the last step."""
    for one in history.extremes:
        place = f"{one.name}, at {coordinates(one.place)}, t = {one.time:.6g}"
        yield place, figure(one.value), one.unit.replace("/", " / ")
    contact = history.contact
    if len(contact.nodes):
        counts = {"stick": contact.stick_count, "slip": contact.slip_count, "are open": contact.open_count}
        said = ", ".join(f"{count[-1]} {name}" for name, count in counts.items())
        yield f"contact nodes at t = {history.times[-1]:.6g}: {said}", str(len(contact.nodes)), ""


def certificates(history: History) -> str:
    """The section on certificates: their meaning, the largest, and those of some steps."""
    run = history.trajectory
    bound = (
        "A certificate bounds the distance of an answer from the exact solution of its step in the energy norm, "
        "whatever the solver says: by the duality gap of the step's convex program, ½ |u − u*|² ≤ gap, and with "
        "Coulomb's law by a solution beside that of the sets that stick, slip and touch. It is relative to the largest "
        "energy norm so far. Steps are certified one by one; the errors of mesh and time steps are not in it."
    )
    estimate = f"In {run.estimated.sum()} steps certificates are estimates, {WHY_ESTIMATED}."
    lines = [
        ("asked for", "-" if run.accuracy is None else short(run.accuracy)),
        ("largest of a step", f"{short(run.certified.max())}, {MEANING[run.certificate_kind]}"),
        ("all steps added up", short(run.certified_total[-1])),
    ]
    columns = history.table("steps")
    # The table has twelve steps at most; steps.csv has all.
    rows = np.unique(np.linspace(0, history.steps, min(12, history.steps + 1)).round().astype(int))
    body = [[(short if "certified" in name else figure)(columns[name][row]) for name in COLUMNS] for row in rows]
    return (
        f"<p>{bound}</p>"
        + (f"<p>{estimate}</p>" if run.estimated.any() else "")
        + words("Relative energy errors", lines)
        + numbers([f"{name}\n{unit}".rstrip() for name, unit in COLUMNS.values()], body)
    )


def budget(history: History) -> str:
    """The section on the error budget, or the reason why there is none."""
    try:
        parts = history.errors or error_budget(history, int(history.stored[-1])).largest
    except VemcvxError as error:
        return f"<p>There is none. {escape(str(error))}</p>"
    rows = [[name, f"{100 * parts[name]:.3g} %", says] for name, says in PARTS.items() if name in parts]
    return (
        "<p>Parts of the largest energy norm of the run, at the last stored step; algebra is certified, the others are "
        "estimated.</p>"
    ) + numbers(["part", "relative energy error", "from"], rows)


# `vemcvx run --report`: a page of HTML that says what was simulated, what came out, how certain it is, and how again.
#
# Pictures and style stand in the page. It is written when a run has succeeded; a run that is refused writes none.


REPORT = "report.html"
CAPTIONS = {
    "deformed_mesh": "The body as it is deformed at the end.",
    "friction_traction": "Friction along the contact boundary, within its bound.",
    "stick_slip_map": "Which part of the contact boundary sticks and slips when.",
    "wear": "Friction work along the contact boundary, to which wear is in proportion.",
    "deformed_body": "The body as it is deformed at the end, and how it is stressed.",
    "contact_face": "Which part of the face of contact sticks and slips at the end, and where to.",
    "friction_disc": "Friction at the end at every contact node, within the disc of its bound.",
    "energy_ledger": "Where the work of the forces goes.",
}
REPORT_STYLE = (
    "body{max-width:60em}h2{margin-top:1.6em;border-bottom:2px solid #0072b2}.wide{overflow-x:auto}"
    "caption{text-align:left;color:#555;white-space:nowrap}th[style]{vertical-align:top}td:not([style],.w),thead th"
    "{white-space:nowrap}figure{margin:1.5em 0;break-inside:avoid}img{max-width:100%;height:auto;display:block}"
    "figcaption{color:#555}pre{white-space:pre-wrap;overflow-wrap:anywhere;background:#f6f6f6;padding:.7em}"
    "@page{margin:15mm}@media print{body{margin:0;padding:0;font-size:12px}h2,h3{break-after:avoid}"
    "table{break-inside:avoid}img{max-height:220mm}pre{font-size:10px}.wide{overflow:visible}}"
)


def write_report(problem: Problem, asked: RunOptions, history: History) -> Path:
    """Write the page into the folder of pictures.

    Raises
    ------
    ProblemError
        It cannot be written.
    """
    sections = {
        "What was simulated": _prose(problem.text) + _scene(problem, asked, history),
        "Pictures": "".join(_pictures(history)),
        "Results": results(history, asked.points),
        "Certificates": certificates(history),
        "Error budget": budget(history),
        "The run": _run(history),
        "How to repeat it": _again(problem, asked),
    }
    run = history.trajectory
    body = f"<p>{history.outline().title}; certified to {run.certified.max():.1e} a step.</p>"
    body += "".join(f"<section><h2>{title}</h2>{text}</section>" for title, text in sections.items())
    path = asked.drawings(problem) / REPORT
    try:
        path.write_text(page(f"{problem.name}: {problem.title}", body, REPORT_STYLE), encoding="utf-8")
    except OSError as error:
        raise ProblemError(f"--report: {path} cannot be written: {error}.") from error
    return path


def check_report(folder: Path) -> None:
    """Raise ProblemError where a file of that name is there that is no page of ours."""
    path = folder / REPORT
    if os.path.lexists(path) and not (path.is_file() and MARK.encode() in path.read_bytes()[:1000]):
        raise ProblemError(f"{path}: not written by vemcvx, so it is not replaced. Choose another folder, or move it.")


def _prose(text: str) -> str:
    """Paragraphs; those that are indented are formulas or commands, and stay as they are set."""
    parts = [part.strip("\n") for part in text.split("\n\n")]
    kinds = [("pre" if part.startswith(" ") else "p", textwrap.dedent(part)) for part in parts if part.strip()]
    return "".join(f"<{kind}>{escape(said)}</{kind}>" for kind, said in kinds)


def _scene(problem: Problem, asked: RunOptions, history: History) -> str:
    """The scene as `vemcvx show` describes it, on the mesh that was used, with the body's extent."""
    mesh, name = history.mesh, mesh_name(problem, asked.family, asked.n) + ", adapted" * (asked.target is not None)
    rows = scene_in_words(problem.scene(asked.settings), mesh, history.trajectory.times, name)
    ends = zip(mesh.points.min(axis=0), mesh.points.max(axis=0), strict=True)
    sides = " × ".join(f"[{figure(low)}, {figure(high)}]" for low, high in ends)
    rows.insert(0, ("body", f"within {sides}; boundaries {', '.join(sorted(mesh.boundaries))}"))
    lines = [(name if k == 0 else "", line) for name, text in rows for k, line in enumerate(text.split("\n"))]
    return words("The scene, as vemcvx show has it", lines)


def _pictures(history: History) -> Iterator[str]:
    for name, drawn in draw_pictures(history).items():
        data, says = base64.b64encode(as_png(drawn, 130)).decode(), CAPTIONS[name]
        yield f'<figure><img src="data:image/png;base64,{data}" alt="{says}"><figcaption>{says}</figcaption></figure>'
    for why in dict.fromkeys(left_out(history).values()):
        yield f"<p>Left out: {escape(why)}.</p>"


def _run(history: History) -> str:
    """The section on the run: mesh, solver, seconds, versions."""
    run, mesh = history.trajectory, history.mesh
    kept = int((history.stored > 0).sum())
    lines = [
        ("mesh", f"{mesh.n_cells} cells, {mesh.n_nodes} nodes, largest diameter {figure(mesh.h)}"),
        ("unknowns", f"{run.state.shape[1]}"),
        ("steps", f"{history.steps}, of which {kept} are stored"),
        ("solver", history.solver),
        ("linear solver", run.linear or "-"),
        ("iterations", f"{run.iterations.sum()} in all, {run.safeguards.sum()} of them safeguards"),
        ("seconds", ", ".join(f"{name} {figure(value)}" for name, value in history.seconds.items())),
        ("written", datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")),
        ("vemcvx", here()),
        ("with", ", ".join(f"{name} {found}" for name in (*NEEDED, *EXTRAS) if (found := version_of(name)))),
    ]
    return words("What was run, when and where", lines)


def _again(problem: Problem, asked: RunOptions) -> str:
    """The command, the parameters it leaves as they are, and the problem file."""
    text = problem.path.read_text(encoding="utf-8", errors="replace")
    return (
        f"<p>By this command, with the problem file below:</p><pre>{escape(asked.command(problem))}</pre>"
        + words("Parameters of the scene", problem.parameters(asked.settings))
        + f"<h3>{escape(problem.path.name)}</h3><pre>{escape(text)}</pre>"
    )
