"""A run in a few lines of words."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Bools
from vemcvx.results.results import Results


def in_words(history: Results) -> str:
    """What was simulated and left out, how certain it is, what it cost."""
    run, touch = history.trajectory, history.contact
    sticks, slips, opened = (int(count[-1]) for count in (touch.stick_count, touch.slip_count, touch.open_count))
    gone = f", {opened} are open" if opened else ""
    lines = [
        f"{history.mesh.n_cells} cells, {history.mesh.n_nodes} nodes, {run.state.shape[1]} unknowns, "
        f"{len(touch.nodes)} contact nodes, {history.steps} steps",
        *(f"left out    {words}" for words in history.inactive),
        f"solver      {history.solver}",
        f"certified   {run.certificate.max():.1e} relative energy error a step "
        f"(floor {run.certificate_floor.max():.1e}), {run.certificate_total[-1]:.1e} accumulated",
        *_kind(run.estimated),
        *_errors(history.errors),
        f"iterations  {int(np.median(run.iterations[1:])) if history.steps else 0} a step at the median, at most "
        f"{run.iterations.max()}; {run.safeguards.sum()} of them safeguards",
        f"energy      stored {run.energy[-1]:.6g}, dissipated {run.dissipated[-1]:.6g}, work {run.work[-1]:.6g}",
        f"contact     {sticks} nodes stick, {slips} slip{gone} in the last step",
        "seconds     " + ", ".join(f"{name} {value:.3g}" for name, value in history.seconds.items()),
    ]
    return "\n".join(lines)


def _kind(estimated: Bools) -> list[str]:
    """Where the certificates are no bounds."""
    if not estimated.any():
        return []
    return [
        f"            an estimate in {estimated.sum()} of {len(estimated) - 1} steps, where what sticks, slips and "
        "touches did not settle; else a bound"
    ]


def _errors(errors: dict[str, float] | None) -> list[str]:
    if errors is None:
        return []
    parts = ", ".join(f"{name} {errors[name]:.2%}" for name in ("algebra", "space", "time"))
    return [f"estimated   {errors['total']:.2%} energy error ({parts}); {errors['target']:.2%} was asked for"]
