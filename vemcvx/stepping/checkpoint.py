"""Going on where an earlier run ended: the state of a stored row, and a mark that tells whether the run is the same.

A stored step has all that the next one begins from: displacement, forces, weights, slips, and what was lost and done so
far. The forces that its friction and contact take are what is out of balance when the next step begins.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import Floats, Ints
from vemcvx.program.certificate import Certificate
from vemcvx.stepping.ledger import Ledger, energy
from vemcvx.stepping.state import Dragged, PreparedRun, State


def mark(run: PreparedRun, times: Floats, kept: Ints) -> Ints:
    """Four numbers that stand for a run: its matrices, instants, stored steps and settings, and some of its data."""
    system, made = run.system, hashlib.blake2b(digest_size=32)
    matrices = [system.K, system.B, system.D, *([] if system.damping is None else [system.damping.C])]
    parts = [part for A in matrices for part in (A.data, A.indices, A.indptr)]
    for t in times[[0, len(times) // 3, len(times) // 2, -1]].tolist():
        parts += [system.force(t), system.remaining_gap(t), system.prescribed_slip(t)]
        if system.norms is not None:
            parts += [system.norms.weights_under(t, np.full(system.D.shape[0], size)) for size in (0.0, 1.0)]
    for part in (times, kept, *parts):
        made.update(np.ascontiguousarray(part).tobytes())
    made.update(repr((run.solver, run.condensation.linear, run.condensation.whole)).encode())
    return np.frombuffer(made.digest(), dtype=np.int64)


def state_of_row(run: PreparedRun, t: float, row: Mapping[str, NDArray[np.generic]]) -> State:
    """The state at `t` from the arrays of a stored step and its scalars, by their names in a trajectory."""
    operators, y, p = run.operators, np.array(row["state"]), np.array(row["pressures"])
    now, m = run.driven(t), operators.count
    lam, weights, sticks = np.array(row["multipliers"]), np.array(row["weights"]), np.array(row["sticking"])
    worn, between, slipped = (np.array(row[name]) for name in ("worn", "worn_second_order", "slipped"))
    ledger = Ledger(
        energy=energy(run.condensation, y[run.condensation.retained], now, p),
        dissipated=float(row["dissipated"]),
        work=float(row["work"]),
        worn=worn[:m],
        slipped=slipped[:m],
        dissipated_second_order=float(row["dissipated_second_order"]),
        worn_second_order=between[:m],
    )
    norms = run.system.norms
    bound = weights[:m] if norms is None else norms.weights_under(t, p, slipped[:m])
    state = State.still(operators, now, y[run.condensation.retained], weights[:m])
    return replace(
        state,
        unbalanced=operators.multiplier_force(lam[:m], p),
        bound=bound,
        lam=lam[:m],
        p=p,
        ledger=ledger,
        scale=max(float(row["unit"]), ledger.norm),
        full=y,
        certificate=Certificate(float(row["gap"]), np.zeros(m), float(row["floor"]), np.zeros_like(p)),
        iterations=int(row["iterations"]),
        dragged=Dragged(
            weights[m:], lam[m:], sticks[m:], worn=worn[m:], worn_second_order=between[m:], slipped=slipped[m:]
        ),
    )
