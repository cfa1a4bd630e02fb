"""A run in a few lines of words."""

from __future__ import annotations

import numpy as np

from vemcvx.outline import Lines, Outline
from vemcvx.results.results import Results


def in_words(history: Results) -> Outline:
    """What was simulated and left out, how certain it is, what it cost."""
    run, touch = history.trajectory, history.contact
    sticks, slips, opened = (int(count[-1]) for count in (touch.stick_count, touch.slip_count, touch.open_count))
    gone = f", {opened} are open" if opened else ""
    title = (
        f"{history.mesh.n_cells} cells, {history.mesh.n_nodes} nodes, {run.state.shape[1]} unknowns, "
        f"{len(touch.nodes)} contact nodes, {history.steps} steps"
    )
    certified = (
        f"{run.certificate.max():.1e} relative energy error a step (floor {run.certificate_floor.max():.1e}), "
        f"{run.certificate_total[-1]:.1e} accumulated"
    )
    iterations = (
        f"{int(np.median(run.iterations[1:])) if history.steps else 0} a step at the median, at most "
        f"{run.iterations.max()}; {run.safeguards.sum()} of them safeguards"
    )
    energy = f"stored {run.energy[-1]:.6g}, dissipated {run.dissipated[-1]:.6g}, work {run.work[-1]:.6g}"
    lines = [
        *(("left out", words) for words in history.inactive),
        ("solver", history.solver),
        ("certified", certified),
        *_kind(history),
        *_errors(history.errors),
        ("iterations", iterations),
        ("energy", energy),
        ("contact", f"{sticks} nodes stick, {slips} slip{gone} in the last step"),
        ("seconds", ", ".join(f"{name} {value:.3g}" for name, value in history.seconds.items())),
    ]
    return Outline(title, lines)


WHY_ESTIMATED = "where what sticks, slips and touches did not settle"
"""What keeps certificates from being bounds; see :mod:`vemcvx.stepping.fixed_point`."""


def _kind(history: Results) -> Lines:
    """Where the certificates are no bounds."""
    estimated = history.trajectory.estimated
    if not estimated.any():
        return []
    at = f"an estimate at {estimated.sum()} of {len(estimated)} instants"
    return [("", f"{at}, {WHY_ESTIMATED}; else a bound")]


def _errors(errors: dict[str, float] | None) -> Lines:
    if errors is None:
        return []
    parts = ", ".join(f"{name} {errors[name]:.2%}" for name in ("algebra", "space", "time"))
    return [("estimated", f"{errors['total']:.2%} energy error ({parts}); {errors['target']:.2%} was asked for")]
