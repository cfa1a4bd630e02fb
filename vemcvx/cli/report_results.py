"""What came out of a run, as parts of its report: results with their units, certificates, the budget of errors."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.cli.pages import figure, numbers, short, words
from vemcvx.errors import VemcvxError
from vemcvx.estimate.budget import error_budget
from vemcvx.history import History
from vemcvx.results.words import WHY_ESTIMATED

ROWS = 12
"""Steps that the table of steps has at most; steps.csv has all."""
FORCE, LENGTH, ENERGY, STRESS = "force", "length", "force × length", "force / length²"
SPREAD = {2: ("length", "force / length"), 3: ("area", STRESS)}
"""Over what forces of contact are spread, and their unit, by the dimension."""
THICKNESS = {2: ", in the plane per unit of thickness", 3: ""}
CARRIES = 1e-9
"""Reactions below this part of the largest are rounding."""
COLUMNS = {
    "step": ("step", ""),
    "time": ("t", ""),
    "energy": ("stored", ENERGY),
    "dissipated": ("dissipated", ENERGY),
    "work": ("work", ENERGY),
    "certificate": ("certificate", "relative"),
    "certificate_total": ("added up", "relative"),
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
    """Energies and extremes of the last stored step, displacements of points, and reactions."""
    run, t = history.trajectory, history.times[-1]
    rows = [
        ("stored energy", figure(run.energy[-1]), ENERGY),
        ("dissipated by friction since the beginning", figure(run.dissipated[-1]), ENERGY),
        ("work of forces and supports since the beginning", figure(run.work[-1]), ENERGY),
        *_extremes(history),
    ]
    units = (
        "Consistent units, those of the problem's data: the unit of force and the unit of length say all others"
        f"{THICKNESS[history.mesh.points.shape[1]]}. Extremes are those of the last stored step, t = "
    )
    forces = {name: history.reaction(name)[-1] for name in history.mesh.boundaries}
    largest = max(float(np.linalg.norm(force)) for force in forces.values())
    held = [(name, force) for name, force in forces.items() if np.linalg.norm(force) > CARRIES * largest]
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
        (f"displacement along {axis}, at {_place(point)}", figure(u[k]), LENGTH)
        for point, u in zip(points, displacements, strict=True)
        for k, axis in enumerate("xyz"[: len(u)])
    ]


def _extremes(history: History) -> Iterator[tuple[str, str, str]]:
    """The largest displacement, stress, slip and pressure, with where they are."""
    mesh, contact = history.mesh, history.contact
    size = np.linalg.norm(history.displacement[-1], axis=1)
    yield _largest("displacement", size, mesh.points, LENGTH)
    last = int(history.stored[-1])
    over, spread = SPREAD[mesh.points.shape[1]]
    if history.out_of_plane is not None or over == "area":
        yield _largest("von Mises stress", history.von_mises(last), mesh.centroids, STRESS)
    yield _largest("principal stress", history.principal_stresses(last)[:, 0], mesh.centroids, STRESS)
    if len(contact.nodes):
        yield _largest("slip", np.linalg.norm(contact.slip[-1], axis=1), contact.points, LENGTH)
        yield _largest(f"friction per {over}", np.linalg.norm(contact.traction[-1], axis=1), contact.points, spread)
        yield _largest(f"contact pressure per {over}", contact.pressure[-1], contact.points, spread)
        counts = {"stick": contact.stick_count, "slip": contact.slip_count, "are open": contact.open_count}
        said = ", ".join(f"{count[-1]} {name}" for name, count in counts.items())
        yield f"contact nodes: {said}", str(len(contact.nodes)), ""


def _largest(name: str, values: Floats, places: Floats, unit: str) -> tuple[str, str, str]:
    k = int(np.argmax(values))
    return f"largest {name}, at {_place(places[k])}", figure(values[k]), unit


def _place(point: Floats) -> str:
    return f"({', '.join(f'{x:.4g}' for x in point)})"


def certificates(history: History) -> str:
    """What certificates are, the largest, and some steps."""
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
        ("largest of a step", f"{short(run.certificate.max())}, {MEANING[run.certificate_kind]}"),
        ("rounding floor", short(run.certificate_floor.max())),
        ("all steps added up", short(run.certificate_total[-1])),
    ]
    columns = history.table("steps")
    rows = np.unique(np.linspace(0, history.steps, min(ROWS, history.steps + 1)).round().astype(int))
    body = [[(short if "certificate" in name else figure)(columns[name][row]) for name in COLUMNS] for row in rows]
    return (
        f"<p>{bound}</p>"
        + (f"<p>{estimate}</p>" if run.estimated.any() else "")
        + words("Relative energy errors", lines)
        + numbers([f"{name}\n{unit}".rstrip() for name, unit in COLUMNS.values()], body)
    )


def budget(history: History) -> str:
    """Where the error comes from, or why nobody says."""
    try:
        parts = history.errors or error_budget(history, int(history.stored[-1])).largest
    except VemcvxError as error:
        return f"<p>There is none. {escape(str(error))}</p>"
    rows = [[name, f"{100 * parts[name]:.3g} %", says] for name, says in PARTS.items() if name in parts]
    return (
        "<p>Parts of the largest energy norm of the run, at the last stored step; algebra is certified, the others are "
        "estimated.</p>"
    ) + numbers(["part", "relative energy error", "from"], rows)
