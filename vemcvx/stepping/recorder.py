"""Which steps are kept, and their rows; at a kept step the certificate is taken on the full system too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vemcvx.errors import SceneError
from vemcvx.stepping.backward_euler import completed, sticking
from vemcvx.stepping.checkpoint import check_same, fingerprint, from_arrays, to_arrays
from vemcvx.stepping.state import Run, State
from vemcvx.stepping.storage import Memory, Storage
from vemcvx.stepping.trajectory import Trajectory

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def stored_steps(store: str | int | Sequence[int], steps: int) -> Ints:
    """Step numbers to keep: "all", "last", every `store`-th and the last, or those given and the last."""
    if isinstance(store, str) and store == "all":
        return np.arange(steps + 1)
    if isinstance(store, str) and store == "last":
        return np.array([steps])
    if isinstance(store, (int, np.integer)) and not isinstance(store, bool) and store >= 1:
        return np.unique(np.append(np.arange(0, steps + 1, store), steps))
    if isinstance(store, (Sequence, np.ndarray)) and not isinstance(store, str) and _numbers(store, steps):
        return np.unique(np.append(np.asarray(store, dtype=np.int64), steps))
    raise SceneError(
        f"store: found {store!r}; there are 'all', 'last', an integer n >= 1 (every n-th and the last), or a sequence "
        f"of step numbers from 0 to {steps}."
    )


def _numbers(store: Sequence[int], steps: int) -> bool:
    return all(isinstance(n, (int, np.integer)) and not isinstance(n, bool) and 0 <= n <= steps for n in store)


SCALARS = (
    *("energy", "dissipated", "work", "norm", "gap", "floor"),
    *("iterations", "safeguards", "contraction", "stuck", "lag"),
)
COUNTS = ("iterations", "safeguards", "stuck")


class Recorder:
    """Rows of a trajectory, entered as the march goes on.

    Parameters
    ----------
    run : Run
    times : (N + 1,) array
    kept : (S,) array
        Numbers of the steps to keep.
    storage : Storage
        Where the rows go.
    """

    def __init__(self, run: Run, times: Floats, kept: Ints, storage: Storage):
        self._run, self._times, self._kept, self._storage = run, times, kept, storage
        self._row = {int(n): row for row, n in enumerate(kept)}
        form, rows = run.form, len(kept)
        # Data are not evaluated for a run that nobody can resume.
        self._mark = np.zeros(0) if isinstance(storage, Memory) else fingerprint(run, times, kept)
        self._state = storage.array("state", (rows, run.system.n))
        self._multipliers = storage.array("multipliers", (rows, form.count, form.block))
        self._pressures = storage.array("pressures", (rows, len(form.softness)))
        self._weights = storage.array("weights", (rows, form.count))
        self._sticks = storage.array("sticking", (rows, form.count), bool)
        self._worn = storage.array("worn", (rows, form.count))
        damped = run.system.damping is not None
        self._velocity = storage.array("velocity", (rows, run.system.n)) if damped else None
        self._scalars = storage.array("scalars", (len(times), len(SCALARS)))

    def resume(self) -> tuple[int, State] | None:
        """The last step that an earlier run completed, and its state.

        Raises
        ------
        HistoryError
            The storage holds another run.
        """
        arrays = self._storage.load()
        if arrays is None:
            return None
        check_same(self._mark, arrays["mark"])
        return from_arrays(self._run, arrays)

    def add(self, n: int, state: State) -> None:
        """Enter the state after step `n`.

        Raises
        ------
        NotCertified
            The answer of a kept step does not hold on the full system.
        """
        row = self._row.get(n)
        if row is not None:
            state = completed(self._run, state, given=n == 0)
            if n > 0 and self._run.check:
                self._run.insist(state, n)
            self._state[row], self._multipliers[row] = state.full, state.lam + state.drive.bias.reshape(state.lam.shape)
            self._pressures[row], self._weights[row] = state.p, state.weights
            self._worn[row] = state.ledger.worn
            if self._velocity is not None and state.velocity is not None:
                self._velocity[row] = state.velocity
        c, ledger = state.certificate, state.ledger
        sticks = sticking(self._run, state) if n > 0 else np.ones(len(ledger.worn), dtype=bool)
        self._scalars[n] = (
            *(ledger.energy, ledger.dissipated, ledger.work, ledger.norm),
            *(c.gap, c.floor, state.iterations, state.safeguards, state.rate, sticks.sum(), state.lag),
        )
        if row is not None:
            self._sticks[row] = sticks
            self._storage.save({"mark": self._mark, **to_arrays(n, state, self._run.system.damping is not None)})

    def finish(self, seconds: dict[str, float]) -> Trajectory:
        """The trajectory."""
        scalars = {name: np.array(column) for name, column in zip(SCALARS, self._scalars.T, strict=True)}
        return Trajectory(
            times=self._times,
            stored=self._kept,
            state=self._state,
            multipliers=self._multipliers,
            pressures=self._pressures,
            weights=self._weights,
            sticking=self._sticks,
            worn=self._worn,
            velocity=self._velocity,
            **{name: column.astype(np.int64) if name in COUNTS else column for name, column in scalars.items()},
            seconds=seconds,
            solver=repr(self._run.solver),
        )
