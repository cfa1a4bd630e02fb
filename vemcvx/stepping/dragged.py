"""Friction on what supports drag along: its slip is given, so it enters no program, and yet rubs.

With c(t) where supports have the norm terms that no unknown moves, and s = c(t_n) - c(t_{n-1}) their slip,

    multiplier = w s / |s| + bias,    loss = w |s| + bias . s,

which is work of the supports, too: their reactions pull against minus the multiplier. Where s = 0, any multiplier up to
the bound would do, and 0 is taken. Weights under pressure are those of the forces p that end the step.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.program.motion import DRAG_ROUNDING
from vemcvx.program.system import System
from vemcvx.stepping.state import Dragged, State


def nothing_dragged(system: System, t: float, p: Floats) -> Dragged:
    """Nothing has been dragged yet."""
    terms = system.dragged
    if terms is None:
        return Dragged.nothing(0, 1 if system.norms is None else system.norms.block)
    none = np.zeros(terms.count)
    return replace(Dragged.nothing(terms.count, terms.block), weights=terms.weights(t, p, none, none))


def with_dragged_friction(system: System, before: State, state: State) -> State:
    """The state with the friction of what supports dragged along since `before`: a loss, and work of the supports."""
    terms = system.dragged
    if terms is None:
        return state
    last, now = terms.position(before.t), terms.position(state.t)
    slip = (now - last).reshape(terms.count, terms.block)
    size = np.linalg.norm(slip, axis=1)
    extent = np.maximum(np.abs(last), np.abs(now)).reshape(slip.shape).max(axis=1)
    still = size <= DRAG_ROUNDING * extent
    past, size = before.dragged.slipped, np.where(still, 0.0, size)
    weights, along = terms.weights(state.t, state.p, past, size), np.where(still, 0.0, 1.0)[:, None] * slip
    lam = along * np.divide(weights, size, out=np.zeros_like(size), where=~still)[:, None]
    if terms.bias is not None:
        lam = lam + np.where(still, 0.0, 1.0)[:, None] * terms.bias(state.t).reshape(slip.shape)
    lost = np.einsum("qb,qb->q", lam, along)
    ledger, total = state.ledger, float(lost.sum())
    ledger = replace(ledger, dissipated=ledger.dissipated + total, work=ledger.work + total)
    return replace(state, ledger=ledger, dragged=Dragged(weights, lam, still, before.dragged.worn + lost, past + size))
