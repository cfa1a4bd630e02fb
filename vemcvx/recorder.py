"""Which steps are kept, and their rows; at a kept step the certificate is taken on the full system too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vemcvx.backward_euler import Run, State, insist
from vemcvx.certificate import EPS, Certificate
from vemcvx.errors import SceneError
from vemcvx.trajectory import Trajectory

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def stored_steps(store: str | int, steps: int) -> Ints:
    """Step numbers to keep: "all", "last", or every `store`-th and the last."""
    if isinstance(store, str) and store == "all":
        return np.arange(steps + 1)
    if isinstance(store, str) and store == "last":
        return np.array([steps])
    if isinstance(store, (int, np.integer)) and not isinstance(store, bool) and store >= 1:
        return np.unique(np.append(np.arange(0, steps + 1, store), steps))
    raise SceneError(
        f"store: found {store!r}; there are 'all', 'last', or an integer n >= 1 (every n-th and the last)."
    )


class Recorder:
    """Rows of a trajectory, collected as the march goes on."""

    def __init__(self, run: Run, kept: Ints):
        self._run, self._kept = run, frozenset(kept.tolist())
        self._rows: list[tuple[int, Floats, State]] = []
        self._scalars: list[tuple[float, ...]] = []

    def add(self, n: int, state: State) -> None:
        """Enter the state after step `n`.

        Raises
        ------
        NotCertified
            The answer of a kept step does not hold on the full system.
        """
        if n in self._kept:
            y = self._run.condensation.recover(state.y, state.drive.force)
            if n > 0:
                state = replace(state, certificate=full_certificate(self._run, state, y))
                if self._run.check:
                    insist(self._run, state, n)
            self._rows.append((n, y, state))
        c, ledger = state.certificate, state.ledger
        self._scalars.append(
            (ledger.energy, ledger.dissipated, ledger.work, ledger.norm, c.gap, c.floor, state.iterations)
        )

    def finish(self, times: Floats, seconds: dict[str, float]) -> Trajectory:
        """The trajectory."""
        energy, dissipated, work, norm, gap, floor, iterations = np.array(self._scalars).T
        steps, states, rows = zip(*self._rows, strict=True)
        return Trajectory(
            times=times,
            stored=np.array(steps),
            state=np.array(states),
            multipliers=np.array([row.lam for row in rows]),
            sticking=np.array([self._sticking(row) for row in rows], dtype=bool),
            energy=energy,
            dissipated=dissipated,
            work=work,
            norm=norm,
            gap=gap,
            floor=floor,
            iterations=iterations.astype(np.int64),
            seconds=seconds,
            solver=repr(self._run.solver),
        )

    def _sticking(self, state: State) -> NDArray[np.bool_]:
        """Increments that the certificate cannot tell from zero: |s_i - s_i*| <= compliance^{1/2} |d - d*|."""
        form = self._run.form
        if form.count == 0:
            return np.zeros(0, dtype=bool)
        blur = EPS * np.abs(form.blocks(form.rows.absolute.read(np.abs(state.y)))).max(axis=1)
        error = state.certificate.error + state.certificate.error_floor
        return np.linalg.norm(state.slip, axis=1) <= error * np.sqrt(form.compliance) + blur


def full_certificate(run: Run, state: State, y: Floats) -> Certificate:
    """The certificate with the residual of the full system in place of the condensed one, if that is larger.

    r = load - B'lam - K y over all unknowns; the norm terms see touched unknowns only and stay as they are.
    """
    system, phi = run.system, state.drive.force.phi
    pulled = np.zeros(system.n) if system.norms is None else system.norms.B.T @ state.lam.ravel()
    r = phi - pulled - system.K @ y
    blur = EPS * (np.abs(phi) + np.abs(pulled) + abs(system.K) @ np.abs(y))
    responses = run.condensation.solve(np.column_stack([r, blur]))
    equilibrium, floor = 0.5 * float(r @ responses[:, 0]), 0.5 * float(blur @ np.abs(responses[:, 1]))
    condensed = state.certificate
    return Certificate(max(equilibrium, condensed.equilibrium), condensed.friction, max(floor, condensed.floor))
