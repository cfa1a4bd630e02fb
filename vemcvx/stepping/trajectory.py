"""The trajectory that `march` returns, and storage in memory or in a folder.

A folder has one memory-mapped ``.npy`` file per array. ``checkpoint.npy`` contains the number of the last stored step,
from which an interrupted run continues.
"""

from __future__ import annotations

import hashlib
import logging
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import Bools, Floats, Ints, array_fields, brief, is_whole
from vemcvx.base.errors import HistoryError, SceneError
from vemcvx.base.outline import ArrayRecord
from vemcvx.base.owned_files import Owned, path_of
from vemcvx.linear import CHUNK_SIZE
from vemcvx.stepping.refusals import require_certified
from vemcvx.stepping.state import Ledger, PreparedRun, State, StepData, certify_together, make_given_state

log = logging.getLogger("vemcvx")

CHECKPOINT = "checkpoint.npy"
BATCH_SIZE = 8  # Number of states that are certified together.


class Memory:
    """Storage of arrays in memory."""

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """Return an array of zeros."""
        try:
            return np.zeros(shape, dtype)
        except (MemoryError, ValueError) as error:
            raise HistoryError(
                f"{name}: no memory for an array of shape {shape}: {error}. Store fewer steps (store='last' or an "
                "integer), or keep rows in files (stream=FOLDER)."
            ) from error

    def clear(self) -> None:
        """Do nothing."""


class Folder(Owned):
    """Storage of arrays in files of a folder."""

    def __init__(self, path: str | Path, resumes: bool = True):
        super().__init__(path_of(path, "stream"))
        self._resumes = resumes

    @property
    def resumes(self) -> bool:
        """True if the folder contains a run that will be continued."""
        return self._resumes and (self.path / CHECKPOINT).exists()

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float, kept: bool = False) -> NDArray[Any]:
        """Return an array in a file, with the values of an earlier run if `kept`, else zeros."""
        if 0 in shape:
            return np.zeros(shape, dtype)
        file = self.take(f"{name}.npy")
        try:
            if kept:
                # Opening a truncated file for writing would fill it with zeros.
                old = np.lib.format.open_memmap(file, mode="r")
                if old.shape != shape or old.dtype != np.dtype(dtype):
                    raise ValueError(f"found {old.dtype} of shape {old.shape}, wanted {np.dtype(dtype)} of {shape}")
                return np.lib.format.open_memmap(file, mode="r+")
            file.unlink(missing_ok=True)
            made = np.lib.format.open_memmap(file, mode="w+", dtype=dtype, shape=shape)
            # A full disk raises an error here, but would crash the process later.
            if hasattr(os, "posix_fallocate"):
                with open(file, "r+b") as opened:
                    os.posix_fallocate(opened.fileno(), 0, file.stat().st_size)
            return made
        except Exception as error:  # NumPy raises various errors for damaged files.
            if kept:
                raise HistoryError(f"{file}: missing, cut short or damaged: {error}. Run without resume.") from error
            raise HistoryError(f"{file}: no room for an array of shape {shape}: {error}.") from error


Storage = Memory | Folder


@dataclass(frozen=True, kw_only=True, repr=False)
class Trajectory(ArrayRecord):
    """The backward-Euler solution of a System, with numbers for all N + 1 instants and arrays for S stored instants.

    Attributes
    ----------
    times : (N + 1,) array
        All instants.
    stored : (S,) array
        Numbers of the stored steps.
    state, velocity : (S, n) arrays
        Unknowns y_n, and velocities (y_n - y_{n-1}) / k_n with the length k_n of the step; None without damping.
    multipliers, pressures : (S, m, block) and (S, r) arrays
        lam and p with K y = load - B'lam - D'p, |lam_i| <= w_i and p >= 0.
    weights : (S, m) array
        w of the norm terms. Dragged terms are last in all arrays (:class:`vemcvx.program.system.DraggedTerms`).
    sticking : (S, m) array of bool
        True if the slip of the step may be zero within the certified error. True for the initial state.
    worn, worn_second_order : (S, m) arrays
        Work of each norm term: the sum of lam_i . s_i over all steps so far, and the sum by the trapezoidal rule.
    slipped : (S, m) array
        Accumulated slip of each norm term: the sum of |s_i| over all steps so far.
    energy, norm : (N + 1,) arrays
        Stored energy 1/2 a(u_n, u_n) + (sum of c p^2 / 2 over limits with compliances c), and energy norm |u_n|_a.
    dissipated, dissipated_second_order : (N + 1,) arrays
        Energy dissipated by friction and damping so far, by backward Euler and by the trapezoidal rule.
    work : (N + 1,) array
        Work of all outer forces so far, with the forces at the end of each step.
    gap, floor : (N + 1,) arrays
        Certified duality gap of each step, and the energy by which rounding may change the gap.
    iterations : (N + 1,) array of int
        Iterations of the solver.
    given_friction : (N + 1,) array of bool
        True if the certificate holds only for the computed weights, which depend on pressures or may fall with slip.
    unit : (N + 1,) array
        Norm by which errors are divided: the largest energy norm so far, or a norm of the data while states are tiny.
    seconds : dict
        Time of "prepare" and "solve" (all steps).
    solver, linear : str
        Name and settings of the solver and of the linear solver.
    accuracy : float
        Requested relative energy error of a step.
    initial : (n,) array
        Unknowns y at the initial instant.
    work_begun : float
        The work (second order) of an earlier run that is continued, else zero.

    Examples
    --------
    >>> system = vx.System(K=np.eye(1), load=lambda t: [3.0 * t], norms=vx.Norms(B=np.eye(1), w=1.0))
    >>> run = vx.march(system, [0.0, 1.0])
    >>> run.energy, run.dissipated
    (array([0., 2.]), array([0., 2.]))
    """

    times: Annotated[Floats, "N", "time"]
    stored: Annotated[Ints, "S", ""]
    state: Annotated[Floats, "S n", "length"]
    multipliers: Annotated[Floats, "S terms block", "force"]
    pressures: Annotated[Floats, "S limits", "force"]
    weights: Annotated[Floats, "S terms", "force"]
    sticking: Annotated[Bools, "S terms", ""]
    worn: Annotated[Floats, "S terms", "energy"]
    worn_second_order: Annotated[Floats, "S terms", "energy"]
    slipped: Annotated[Floats, "S terms", "length"]
    energy: Annotated[Floats, "N", "energy"]
    dissipated: Annotated[Floats, "N", "energy"]
    dissipated_second_order: Annotated[Floats, "N", "energy"]
    work: Annotated[Floats, "N", "energy"]
    norm: Annotated[Floats, "N", "energy^(1/2)"]
    gap: Annotated[Floats, "N", "energy"]
    floor: Annotated[Floats, "N", "energy"]
    iterations: Annotated[Ints, "N", ""]
    given_friction: Annotated[Bools, "N", ""]
    seconds: dict[str, float]
    solver: str
    linear: str
    accuracy: float
    unit: Annotated[Floats, "N", "energy^(1/2)"]
    initial: Annotated[Floats, "n", "length"]
    velocity: Annotated[Floats | None, "S n", "length/time"] = None
    work_begun: float = 0.0

    @property
    def work_second_order(self) -> Floats:
        """The work (N + 1,) by the energy balance: `work_begun` plus the growth of stored and dissipated energy."""
        lost = self.dissipated_second_order
        work: Floats = self.work_begun + self.energy - self.energy[0] + lost - lost[0]
        return work

    @property
    def certificate(self) -> Floats:
        """The certified relative energy error (N + 1,) of each step: sqrt(2 gap_n) / `unit`."""
        return relative(np.sqrt(2 * self.gap), self.unit)

    @property
    def certificate_kind(self) -> str:
        """The kind of `certificate`: "bound", or "for the given friction" if `given_friction` is True at an instant."""
        return "for the given friction" if self.given_friction.any() else "bound"

    @property
    def certificate_floor(self) -> Floats:
        """The rounding floor (N + 1,) of `certificate`: sqrt(2 floor_n) / `unit`."""
        return relative(np.sqrt(2 * self.floor), self.unit)

    @property
    def certified(self) -> Floats:
        """The bound (N + 1,) on the relative energy error of each step, including rounding: certificate plus floor."""
        return self.certificate + self.certificate_floor

    @property
    def above_asked(self) -> str:
        """A message if `certified` exceeds the requested accuracy, else empty."""
        asked, worst = self.accuracy, float(self.certified.max())
        if worst <= asked:
            return ""
        missed = np.count_nonzero((self.certificate > asked) & (self.gap > self.floor))
        if missed:
            return f"asked for {asked:.3g}, missed at {missed} of {len(self.times)} instants"
        return f"asked for {asked:.3g}; round-off leaves {worst:.1e}"

    @property
    def certificate_total(self) -> Floats:
        """The accumulated relative error (N + 1,): the sum of the errors of all steps so far.

        With prescribed weights and no limits, |u_n - u_n*|_a <= this error times `unit` for exact states u_n*.
        """
        return relative(np.cumsum(np.sqrt(2 * self.gap)), self.unit)

    @property
    def certified_total(self) -> Floats:
        """The accumulated relative error (N + 1,), including rounding: see `certificate_total`."""
        return relative(np.cumsum(np.sqrt(2 * self.gap) + np.sqrt(2 * self.floor)), self.unit)


def relative(error: Floats, scale: Floats) -> Floats:
    """Return error / scale, with 0 for 0/0, and infinity for quotients that are not defined."""
    known = (error >= 0) & (scale > 0) & (scale < np.inf)
    ratio = np.divide(error, scale, out=np.full(np.shape(error), np.inf), where=known)
    return np.where((error == 0) & (scale == 0), 0.0, ratio)


def choose_stored_steps(store: str | int | Sequence[int], steps: int) -> Ints:
    """Return the numbers of the steps that the argument `store` of `march` selects."""
    if isinstance(store, str) and store in ("all", "last"):
        return np.arange(steps + 1) if store == "all" else np.array([steps])
    if is_whole(store) and store >= 1:
        return np.unique(np.append(np.arange(0, steps + 1, min(store, steps + 1)), steps))
    numbers = store.tolist() if isinstance(store, np.ndarray) else store
    if isinstance(numbers, (list, tuple, range)) and all(is_whole(n) and 0 <= n <= steps for n in numbers):
        return np.unique(np.append(np.array(numbers, dtype=np.int64), steps))
    raise SceneError(
        f"store: found {brief(store)}; wanted 'all', 'last', an integer n >= 1 (every n-th step and the last), or a "
        f"sequence of step numbers from 0 to {steps}."
    )


FIELDS = {name: of for name, of in array_fields(Trajectory).items() if name not in ("times", "stored")}
TYPES: dict[str, type] = {"f": float, "i": np.int64, "b": bool}


class Recorder:
    """A writer of states into the arrays of a trajectory."""

    def __init__(self, run: PreparedRun, times: Floats, kept: Ints, storage: Storage):
        self._run, self._times, self._kept, self._storage = run, times, kept, storage
        self._mark = hash_run(run, times, kept) if isinstance(storage, Folder) else [0] * 4
        room = max(1, min(BATCH_SIZE, CHUNK_SIZE // (12 * max(run.system.n, 1))))
        self._most, self._waiting = room if run.condensation.linear.eliminates else 1, dict[int, State]()
        sizes = {"N": len(times), "S": len(kept), "n": run.system.n, "terms": run.terms, "block": run.system.block}
        sizes["limits"] = len(run.operators.compliance)
        self._shapes = {
            name: (tuple(sizes[size] for size in of.sizes), TYPES[of.kind])
            for name, of in FIELDS.items()
            if name != "velocity" or run.system.damping is not None
        }

    def begin(self) -> tuple[int, State] | None:
        """Return the last stored step and state of an earlier run, or None."""
        folder = self._storage
        if not (isinstance(folder, Folder) and folder.resumes):
            return None
        self._checkpoint = folder.array("checkpoint", (5,), np.int64, kept=True)
        n, *known = self._checkpoint.tolist()
        if known != self._mark:
            raise HistoryError(
                "resume: the folder holds a run of another scene, mesh, times or store, or with other settings. Resume "
                "with the original ones, or choose an empty folder."
            )
        if n < 0:
            return None
        self._rows = {name: folder.array(name, *shape, kept=True) for name, shape in self._shapes.items()}
        state = state_of_row(self._run, float(self._times[n]), row_of(self._rows, self._kept, n))
        log.info("resuming after step %d of %d, at t = %g", n, len(self._times) - 1, state.t)
        return n, state

    def add(self, n: int, state: State) -> None:
        """Add the state after step `n`."""
        if n == 0:
            self._storage.clear()
            self._rows = {name: self._storage.array(name, *shape) for name, shape in self._shapes.items()}
            self._checkpoint = self._storage.array("checkpoint", (5,), np.int64)
            self._checkpoint[:] = [-1, *self._mark]
        self._waiting[n] = state
        if n == 0 or len(self._waiting) >= self._most:
            self.enter_waiting()

    def enter_waiting(self) -> None:
        """Write the waiting states with certificates, or raise NotCertified."""
        waiting, self._waiting = self._waiting, {}
        kept = {n: state for n, state in waiting.items() if (n == 0 or n in self._kept) and state.full is None}
        waiting |= zip(kept, certify_together(self._run, list(kept.values())), strict=True)
        for n, state in waiting.items():
            if n in kept and n > 0 and self._run.check:
                require_certified(self._run, state, n)
            row = _row(state, self._run.solver.accuracy)
            for name, place in row_of(self._rows, self._kept, n).items():
                place[...] = row[name]
            if n in self._kept:
                self._checkpoint[0] = n

    def finish(self, seconds: dict[str, float], work_begun: float) -> Trajectory:
        """Return the trajectory."""
        run = self._run
        return Trajectory(
            times=self._times,
            stored=self._kept,
            **{name: np.array(rows) if FIELDS[name].sizes == ("N",) else rows for name, rows in self._rows.items()},
            seconds=seconds,
            solver=repr(run.solver),
            linear=repr(run.condensation.linear),
            accuracy=float(run.solver.accuracy),
            work_begun=work_begun,
        )


def row_of(arrays: Mapping[str, NDArray[Any]], kept: Ints, n: int) -> dict[str, NDArray[Any]]:
    """Return views of the rows of step `n` in the arrays of a trajectory, by name."""
    row = np.flatnonzero(kept == n).tolist()
    at: dict[str, list[Any]] = {"N": [n], "S": row, "n": [slice(None)] if n == 0 else []}
    return {name: arrays[name][(i, ...)] for name in arrays for i in at[FIELDS[name].sizes[0]]}


def _row(state: State, accuracy: float) -> dict[str, Any]:
    certificate = state.certificate
    return {
        **vars(state.ledger),
        "state": state.full,
        "initial": state.full,
        "multipliers": state.lam,
        "pressures": state.p,
        "weights": state.weights,
        "sticking": state.sticks,
        "velocity": 0.0 if state.velocity is None else state.velocity,
        "norm": state.ledger.norm,
        "gap": certificate.gap,
        "floor": certificate.floor,
        "iterations": state.iterations,
        "given_friction": certificate.given_friction,
        "unit": state.unit(accuracy),
    }


def state_of_row(run: PreparedRun, t: float, row: Mapping[str, NDArray[Any]]) -> State:
    """Return the state at `t`, read from a row of each array of a trajectory."""
    now = StepData.evaluate(run.condensation, t)
    if "state" not in row:
        return make_given_state(run, now, np.array(row["initial"]))
    read: dict[str, Any] = {name: np.array(value) if value.ndim else value.item() for name, value in row.items()}
    ledger = Ledger(**{field.name: read[field.name] for field in fields(Ledger)})
    state, m, norms = make_given_state(run, now, read["state"], ledger), run.operators.count, run.system.norms
    lam, p, weights = (read[name] for name in ("multipliers", "pressures", "weights"))
    # After a step without dashpots, B'lam + D'p is more accurate than load - K y.
    balanced = run.system.damping is None and "initial" not in row
    held = run.operators.multiplier_force(lam[:m], p) if balanced else state.unbalanced
    return replace(
        state,
        unbalanced=held,
        weights=weights,
        bound=weights if norms is None else np.append(norms.weights_under(t, p, ledger.slipped[:m]), weights[m:]),
        lam=lam,
        p=p,
        ledger=ledger,
        scale=max(read["unit"], ledger.norm),
        iterations=read["iterations"],
    )


def hash_run(run: PreparedRun, times: Floats, kept: Ints) -> list[int]:
    """Return the hash of a run as four integers."""
    system, made = run.system, hashlib.blake2b(digest_size=32)
    matrices = [system.K, system.B, system.D, *([] if system.damping is None else [system.damping.C])]
    parts = [part for A in matrices for part in (A.data, A.indices, A.indptr)]
    for t in times[[0, len(times) // 3, len(times) // 2, -1]].tolist():
        parts += [system.force(t), system.remaining_gap(t), system.slip_of_supports(t)]
        if system.norms is not None:
            parts += [system.norms.weights_under(t, np.full(system.D.shape[0], size)) for size in (0.0, 1.0)]
    for part in (times, kept, *parts):
        made.update(np.ascontiguousarray(part).tobytes())
    made.update(repr((run.solver, run.condensation.linear, run.condense)).encode())
    return np.frombuffer(made.digest(), dtype=np.int64).tolist()
