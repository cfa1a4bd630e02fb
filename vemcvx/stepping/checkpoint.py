"""A state as arrays, and back: what a run needs to go on after it was interrupted."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.errors import HistoryError, VemcvxError
from vemcvx.program.certificate import Certificate
from vemcvx.program.system import System
from vemcvx.stepping.ledger import Ledger, drive
from vemcvx.stepping.state import Run, State
from vemcvx.stepping.storage import Arrays

Floats = NDArray[np.float64]


def fingerprint(run: Run, times: Floats, kept: NDArray[Any]) -> NDArray[np.int64]:
    """Numbers that two runs share only if one may go on where the other stopped.

    Data are looked at at the first, the middle and the last instant.
    """
    system = run.system
    fixed = [
        system.K.data,
        run.form.B.data,
        run.form.D.data,
        run.form.softness,
        times,
        np.asarray(kept, dtype=np.int64),
    ]
    varying = [_driven(system, float(t)) for t in times[[0, len(times) // 2, -1]]]
    return np.array([system.n, run.form.count, *(zlib.crc32(np.ascontiguousarray(p)) for p in fixed + varying)])


def _driven(system: System, t: float) -> Floats:
    """What drives a system at an instant, one after the other; nothing where its data fail, as their step will say."""
    norms, motion = system.norms, system.motion
    try:
        parts = [system.force(t), system.reach(t)]
        if norms is not None:
            parts += [norms.weights_under(t, np.ones(len(parts[1]))), norms.tilt(t)]
        if motion is not None:
            parts += [motion.stretch(t), motion.drag(t)]
    except VemcvxError:
        return np.zeros(0)
    return np.concatenate(parts)


def to_arrays(n: int, state: State, whole: bool) -> Arrays:
    """The state after step `n`; with all its unknowns where the next step needs them."""
    certificate, ledger = state.certificate, state.ledger
    numbers = [
        n,
        state.t,
        state.scale,
        state.iterations,
        ledger.energy,
        ledger.dissipated,
        ledger.work,
        certificate.equilibrium,
        certificate.floor,
    ]
    return {
        "numbers": np.array(numbers, dtype=float),
        "y": state.y,
        "unbalanced": state.unbalanced,
        "weights": state.weights,
        "lam": state.lam,
        "p": state.p,
        "slip": state.slip,
        "worn": ledger.worn,
        "full": state.full if whole and state.full is not None else np.zeros(0),
        "friction": certificate.friction,
        "limits": certificate.limits,
    }


def from_arrays(run: Run, arrays: Arrays) -> tuple[int, State]:
    """The step number and the state; what drives the system is evaluated anew."""
    try:
        n, t, scale, iterations, energy, dissipated, work, equilibrium, floor = arrays["numbers"].tolist()
        certificate = Certificate(equilibrium, arrays["friction"], floor, arrays["limits"])
        ledger = Ledger(energy, dissipated, work, arrays["worn"])
        parts = (arrays["y"], arrays["unbalanced"], drive(run.system, run.condensation, t), arrays["weights"])
        state = State(
            t,
            *parts,
            arrays["weights"],
            arrays["lam"],
            arrays["p"],
            arrays["slip"],
            certificate,
            ledger,
            scale,
            int(iterations),
            full=arrays["full"] if len(arrays["full"]) else None,
        )
    except (KeyError, ValueError) as error:
        raise HistoryError(f"checkpoint: incomplete: {error}. Remove the folder and run again.") from error
    return int(n), state


def check_same(run_mark: NDArray[np.int64], kept_mark: NDArray[np.int64]) -> None:
    """Raise HistoryError when a checkpoint belongs to another run."""
    if not np.array_equal(run_mark, kept_mark):
        raise HistoryError(
            "resume: the folder holds a run of another scene, mesh, times or store. "
            "Resume with what it was begun with, or choose an empty folder."
        )
