"""When a step is good enough, and what to say when it is not."""

from __future__ import annotations

import numpy as np

from vemcvx.errors import NotCertified
from vemcvx.program.certificate import Certificate
from vemcvx.program.system import Norms
from vemcvx.solvers import Newton, Solver


def insist(
    solver: Solver, norms: Norms | None, certificate: Certificate, scale: float, status: str, n: int, t: float
) -> None:
    """Raise NotCertified when step `n` misses the solver's accuracy.

    Parameters
    ----------
    solver : Solver
    norms : Norms or None
        For the name of the place where most of the gap sits.
    certificate : Certificate
    scale : float
        Largest energy norm of the states so far: what errors are relative to.
    status : str
        The solver's own words.
    n, t : int, float
        The step and its instant.
    """
    accuracy = solver.accuracy
    if certificate.error <= accuracy * scale or certificate.nothing(scale):
        return
    unit = scale or np.nan
    reached, floor = certificate.error / unit, certificate.error_floor / unit
    worst = ""
    if norms is not None and len(certificate.friction):
        worst = f" The largest share of the gap sits at {norms.name(int(np.argmax(certificate.friction)))}."
    said = f" The solver said: {status}." if status else ""
    raise NotCertified(
        f"step {n} at t = {t:.6g}: {solver.name} reached a certified relative energy error of {reached:.1e}, asked was "
        f"{accuracy:.1e} (round-off floor {floor:.1e}).{said}{worst} {_advice(solver, reached, accuracy, floor)}, or "
        "pass check=False to go on regardless.",
        step=n,
        time=t,
        reached=reached,
        asked=accuracy,
        floor=floor,
    )


def _advice(solver: Solver, reached: float, accuracy: float, floor: float) -> str:
    other = "raise max_iterations" if isinstance(solver, Newton) else "use vx.Newton()"
    if hasattr(solver, "polish") and not solver.polish:
        other = f"use polish=True, or {other.removeprefix('use ')}"
    if not reached < 0.5:
        return f"Nothing was answered that could be relied on: {other}"
    if floor > accuracy:
        return f"Round-off alone allows {floor:.1e}: ask for no more than that"
    return f"Ask for accuracy={2 * reached:.0e} or more, {other}"
