"""`vemcvx run --report`: a page of HTML that says what was simulated, what came out, how certain it is, and how again.

Pictures and style stand in the page. It is written when a run has succeeded; a run that is refused writes none.
"""

from __future__ import annotations

import base64
import os
import textwrap
from collections.abc import Iterator
from datetime import UTC, datetime
from html import escape
from pathlib import Path

from vemcvx.canvas import as_png
from vemcvx.cli.doctor import EXTRAS, NEEDED, here, version_of
from vemcvx.cli.pages import MARK, figure, page, words
from vemcvx.cli.problem_file import Problem
from vemcvx.cli.report_results import budget, certificates, results
from vemcvx.cli.run_options import RunOptions
from vemcvx.cli.show import mesh_name, scene_in_words
from vemcvx.errors import ProblemError
from vemcvx.history import History
from vemcvx.plots.pictures import draw_pictures, left_out

REPORT = "report.html"
DPI = 130
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
STYLE = (
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
    body = f"<p>{history.outline().title}; certified to {run.certificate.max():.1e} a step.</p>"
    body += "".join(f"<section><h2>{title}</h2>{text}</section>" for title, text in sections.items())
    path = asked.drawings(problem) / REPORT
    try:
        path.write_text(page(f"{problem.name}: {problem.title}", body, STYLE), encoding="utf-8")
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
    """What `vemcvx show` says, of the mesh that was used, and where it is."""
    mesh, name = history.mesh, mesh_name(problem, asked.family, asked.n) + ", adapted" * (asked.target is not None)
    rows = scene_in_words(problem.scene(asked.settings), mesh, history.trajectory.times, name)
    ends = zip(mesh.points.min(axis=0), mesh.points.max(axis=0), strict=True)
    sides = " × ".join(f"[{figure(low)}, {figure(high)}]" for low, high in ends)
    rows.insert(0, ("body", f"within {sides}; boundaries {', '.join(sorted(mesh.boundaries))}"))
    lines = [(name if k == 0 else "", line) for name, text in rows for k, line in enumerate(text.split("\n"))]
    return words("The scene, as vemcvx show has it", lines)


def _pictures(history: History) -> Iterator[str]:
    for name, drawn in draw_pictures(history).items():
        data, says = base64.b64encode(as_png(drawn, DPI)).decode(), CAPTIONS[name]
        yield f'<figure><img src="data:image/png;base64,{data}" alt="{says}"><figcaption>{says}</figcaption></figure>'
    for why in dict.fromkeys(left_out(history).values()):
        yield f"<p>Left out: {escape(why)}.</p>"


def _run(history: History) -> str:
    """What was run, where, and what it cost."""
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
