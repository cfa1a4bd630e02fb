"""The trajectory that `march` returns, states, multipliers, energies, certificates; its recorder; where rows are kept.

Rows are kept in memory, or in a folder that outlives the process, one ``.npy`` file an array, mapped into memory: the
disk bounds the size of a history, and not memory. ``checkpoint.npy`` has the last stored step, from which a run that
was interrupted goes on. :mod:`vemcvx.base.owned_files` says which files are a run's.
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

from vemcvx.base.arrays import Bools, Floats, Ints, brief, is_whole, quantities
from vemcvx.base.errors import HistoryError, SceneError
from vemcvx.base.outline import ArrayRecord
from vemcvx.base.owned_files import Owned, path_of
from vemcvx.linear import CHUNK_SIZE
from vemcvx.stepping.refusals import require_certified
from vemcvx.stepping.state import Ledger, PreparedRun, State, StepData, certified_together, state_given

log = logging.getLogger("vemcvx")

CHECKPOINT = "checkpoint.npy"
TOGETHER = 8
"""States that are certified in full at once: of 8,256 unknowns in a third of the time that one by one take."""


class Memory:
    """Rows in memory, which do not outlive the process."""

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float) -> NDArray[Any]:
        """Return zeros."""
        try:
            return np.zeros(shape, dtype)
        except (MemoryError, ValueError) as error:
            raise HistoryError(
                f"{name}: no memory for an array of shape {shape}: {error}. Store fewer steps (store='last' or an "
                "integer), or keep rows in files (stream=FOLDER)."
            ) from error

    def clear(self) -> None:
        """Delete nothing."""


class Folder(Owned):
    """Rows in files of a folder, made if need be, that resumes the run it holds or begins anew; used by ``with``.

    HistoryError where the folder cannot be made or written to, or another run is on in it.
    """

    def __init__(self, path: str | Path, resumes: bool = True):
        super().__init__(path_of(path, "stream"))
        self._resumes = resumes

    @property
    def resumes(self) -> bool:
        """True if the run that it holds is to be gone on with."""
        return self._resumes and (self.path / CHECKPOINT).exists()

    def array(self, name: str, shape: tuple[int, ...], dtype: Any = float, kept: bool = False) -> NDArray[Any]:
        """Return the array that an earlier run has `kept`, or a new file of zeros.

        Histories that still look at an earlier file of that name keep what they see.
        """
        if 0 in shape:
            return np.zeros(shape, dtype)
        file = self.take(f"{name}.npy")
        try:
            if kept:
                # To be written to, a file that was cut short would be filled up with zeros.
                old = np.lib.format.open_memmap(file, mode="r")
                if old.shape != shape or old.dtype != np.dtype(dtype):
                    raise ValueError(f"found {old.dtype} of shape {old.shape}, wanted {np.dtype(dtype)} of {shape}")
                return np.lib.format.open_memmap(file, mode="r+")
            file.unlink(missing_ok=True)
            made = np.lib.format.open_memmap(file, mode="w+", dtype=dtype, shape=shape)
            # The space is taken now: a full disk is an error here, and a crash once the file is mapped.
            if hasattr(os, "posix_fallocate"):
                with open(file, "r+b") as opened:
                    os.posix_fallocate(opened.fileno(), 0, file.stat().st_size)
            return made
        except Exception as error:  # damage shows as whatever numpy or its parser of headers stumbles over
            if kept:
                raise HistoryError(f"{file}: missing, cut short or damaged: {error}. Run without resume.") from error
            raise HistoryError(f"{file}: no room for an array of shape {shape}: {error}.") from error


Storage = Memory | Folder


@dataclass(frozen=True, kw_only=True, repr=False)
class Trajectory(ArrayRecord):
    """The backward-Euler solution of a System; scalars for all N + 1 instants, arrays for the stored S.

    Attributes
    ----------
    times : (N + 1,) array
        All instants.
    stored : (S,) array
        Step numbers of the rows of `state`, `multipliers` and `sticking`.
    state : (S, n) array
        y at the stored instants.
    multipliers : (S, m, block) array
        lam with K y = load - B'lam - D'p and |lam_i| <= w_i.
    pressures : (S, r) array
        p >= 0 of the limits.
    weights : (S, m) array
        w of the norm terms.
    sticking : (S, m) array of bool
        True where the increment B_i (y - y_prev) cannot be told from zero, and in row 0.
    worn : (S, m) array
        Work of each norm term: the sum of its lam_i . s_i over all steps so far, stored or not. A row sums to
        `dissipated`, but for what damping loses. Terms whose slip supports give
        (:class:`vemcvx.program.system.DraggedTerms`) follow the others, here as everywhere.
    slipped : (S, m) array
        Slip of each norm term, to and fro: the sum of its |s_i|, likewise.
    stuck : (N + 1,) array of int
        Number of norm terms with such an increment, step by step.
    energy : (N + 1,) array
        Stored energy 1/2 a(u, u).
    dissipated : (N + 1,) array
        Cumulative sum of lam_i . s_i, which is w_i |s_i| at a solution, and of what damping loses.
    dissipated_second_order : (N + 1,) array
        Likewise with the weights of both ends of every step: of second order in their length, where `dissipated` is of
        first (:mod:`vemcvx.stepping.state`).
    worn_second_order : (S, m) array
        Of `worn`, likewise.
    work : (N + 1,) array
        Cumulative work of loads, supports, obstacles and ground: end-of-step forces times increments.
    norm : (N + 1,) array
        Energy norm |u_n|_a.
    gap : (N + 1,) array
        Certified duality gap of each step.
    floor : (N + 1,) array
        The part of `gap` that round-off alone may account for.
    iterations : (N + 1,) array of int
        Iterations of the solver.
    safeguards : (N + 1,) array of int
        Iterations in which a globally convergent method stood in for a faster one.
    given_friction : (N + 1,) array of bool
        Where weights follow the answer, and the certificate is that of the program with those of its own pressure and
        slip.
    unit : (N + 1,) array
        The energy norm that errors are relative to: the largest so far, or what the data could cause where all so far
        are zero at the accuracy asked (:mod:`vemcvx.stepping.backward_euler`).
    seconds : dict
        "prepare" (factorisation, condensation, compilation) and "solve" (all steps).
    solver : str
        Name and settings of the solver that answered.
    linear : str
        Name and settings of the linear solver.
    accuracy : float
        The certified relative energy error that was asked of a step.
    initial : (n,) array
        y at the initial instant, stored or not.
    velocity : (S, n) array or None
        (y_n - y_{n-1}) / k_n, where rates cost; zero in row 0, to which no step leads.
    work_begun : float
        `work_second_order` at the initial instant: that of the run that this one goes on from, else zero.
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
    stuck: Annotated[Ints, "N", ""]
    energy: Annotated[Floats, "N", "energy"]
    dissipated: Annotated[Floats, "N", "energy"]
    dissipated_second_order: Annotated[Floats, "N", "energy"]
    work: Annotated[Floats, "N", "energy"]
    norm: Annotated[Floats, "N", "energy^(1/2)"]
    gap: Annotated[Floats, "N", "energy"]
    floor: Annotated[Floats, "N", "energy"]
    iterations: Annotated[Ints, "N", ""]
    safeguards: Annotated[Ints, "N", ""]
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
        """(N + 1,) the work since the initial instant by the balance of energies: what is stored and what is lost."""
        lost = self.dissipated_second_order
        work: Floats = self.work_begun + self.energy - self.energy[0] + lost - lost[0]
        return work

    @property
    def certificate(self) -> Floats:
        """(N + 1,) certified relative energy error of each step: sqrt(2 gap_n) / max over m <= n of |u_m|_a.

        While all |u_m|_a are zero at the accuracy asked, relative to what the data could cause instead.
        """
        return relative(np.sqrt(2 * self.gap), self.unit)

    @property
    def certificate_kind(self) -> str:
        """The kind of `certificate`: "bound", or "for the given friction" where that follows the answer."""
        return "for the given friction" if self.given_friction.any() else "bound"

    @property
    def certificate_floor(self) -> Floats:
        """(N + 1,) the rounding floor of `certificate`: sqrt(2 floor_n) / max over m <= n of |u_m|_a."""
        return relative(np.sqrt(2 * self.floor), self.unit)

    @property
    def certified(self) -> Floats:
        """(N + 1,) the bound on the relative energy error of each step, rounding included: certificate and floor."""
        return self.certificate + self.certificate_floor

    @property
    def above_asked(self) -> str:
        """The accuracy asked for and why `certified` exceeds it, in words; empty where it does not."""
        asked, worst = self.accuracy, float(self.certified.max())
        if worst <= asked:
            return ""
        missed = np.count_nonzero((self.certificate > asked) & (self.gap > self.floor))
        if missed:
            return f"asked for {asked:.3g}, missed at {missed} of {len(self.times)} instants"
        return f"asked for {asked:.3g}; round-off leaves {worst:.1e}"

    @property
    def certificate_total(self) -> Floats:
        """(N + 1,) certified relative error of u_n, all steps' errors accumulated.

        The step map u_prev -> u_n of norms with given weights is nonexpansive in the energy norm, so
        |u_n - u_n*|_a <= sum over m <= n of sqrt(2 gap_m). With limits it is only if they never act; else the sum is
        that of the steps' own errors and no bound.
        """
        return relative(np.cumsum(np.sqrt(2 * self.gap)), self.unit)

    @property
    def certified_total(self) -> Floats:
        """(N + 1,) `certified`, all steps' errors accumulated: see `certificate_total`."""
        return relative(np.cumsum(np.sqrt(2 * self.gap) + np.sqrt(2 * self.floor)), self.unit)


def relative(error: Floats, scale: Floats) -> Floats:
    """error / scale with 0/0 = 0; infinite where this is no number, which certifies nothing."""
    known = (error >= 0) & (scale > 0) & (scale < np.inf)
    ratio = np.divide(error, scale, out=np.full(np.shape(error), np.inf), where=known)
    return np.where((error == 0) & (scale == 0), 0.0, ratio)


def stored_steps(store: str | int | Sequence[int], steps: int) -> Ints:
    """Step numbers to keep: "all", "last", every `store`-th and the last, or those given and the last."""
    if isinstance(store, str) and store in ("all", "last"):
        return np.arange(steps + 1) if store == "all" else np.array([steps])
    if is_whole(store) and store >= 1:
        return np.unique(np.append(np.arange(0, steps + 1, min(store, steps + 1)), steps))
    numbers = store.tolist() if isinstance(store, np.ndarray) else store
    if isinstance(numbers, (list, tuple, range)) and all(is_whole(n) and 0 <= n <= steps for n in numbers):
        return np.unique(np.append(np.array(numbers, dtype=np.int64), steps))
    raise SceneError(
        f"store: found {brief(store)}; there are 'all', 'last', an integer n >= 1 (every n-th and the last), or a "
        f"sequence of step numbers from 0 to {steps}."
    )


FIELDS = {name: of for name, of in quantities(Trajectory).items() if name not in ("times", "stored")}
TYPES: dict[str, type] = {"f": float, "i": np.int64, "b": bool}


class Recorder:
    """Rows of a trajectory, entered as the march goes on; the steps `kept` (S,) of the instants `times` have them.

    States wait for each other: those that are kept are certified in full together.
    """

    def __init__(self, run: PreparedRun, times: Floats, kept: Ints, storage: Storage):
        self._run, self._times, self._kept, self._storage = run, times, kept, storage
        self._mark = mark(run, times, kept) if isinstance(storage, Folder) else [0] * 4
        room = max(1, min(TOGETHER, CHUNK_SIZE // (12 * max(run.system.n, 1))))
        self._most, self._waiting = room if run.condensation.linear.eliminates else 1, dict[int, State]()
        sizes = {"N": len(times), "S": len(kept), "n": run.system.n, "terms": run.terms, "block": run.system.block}
        sizes["limits"] = len(run.operators.compliance)
        self._shapes = {
            name: (tuple(sizes[size] for size in of.sizes), TYPES[of.kind])
            for name, of in FIELDS.items()
            if name != "velocity" or run.system.damping is not None
        }

    def begin(self) -> tuple[int, State] | None:
        """The last step that an earlier run has stored and its state, if there was one.

        HistoryError where the storage holds another run, or rows of it are missing.
        """
        folder = self._storage
        if not (isinstance(folder, Folder) and folder.resumes):
            return None
        self._checkpoint = folder.array("checkpoint", (5,), np.int64, kept=True)
        n, *known = self._checkpoint.tolist()
        if known != self._mark:
            raise HistoryError(
                "resume: the folder holds a run of another scene, mesh, times or store, or with other settings. Resume "
                "with what it was begun with, or choose an empty folder."
            )
        if n < 0:
            return None
        self._rows = {name: folder.array(name, *shape, kept=True) for name, shape in self._shapes.items()}
        state = state_of_row(self._run, float(self._times[n]), row_of(self._rows, self._kept, n))
        log.info("going on after step %d of %d, at t = %g", n, len(self._times) - 1, state.t)
        return n, state

    def add(self, n: int, state: State) -> None:
        """Enter the state after step `n`; with the initial one, 0, a new run begins.

        NotCertified where the answer of a kept step does not hold on the full system.
        """
        if n == 0:
            self._storage.clear()
            self._rows = {name: self._storage.array(name, *shape) for name, shape in self._shapes.items()}
            self._checkpoint = self._storage.array("checkpoint", (5,), np.int64)
            self._checkpoint[:] = [-1, *self._mark]
        self._waiting[n] = state
        if n == 0 or len(self._waiting) >= self._most:
            self.enter_waiting()

    def enter_waiting(self) -> None:
        """Enter the states that wait, in the order of their steps, and none after one that is not certified."""
        waiting, self._waiting = self._waiting, {}
        kept = {n: state for n, state in waiting.items() if n == 0 or n in self._kept}
        waiting |= zip(kept, certified_together(self._run, list(kept.values())), strict=True)
        for n, state in waiting.items():
            if n in kept and n > 0 and self._run.check:
                require_certified(self._run, state, n)
            row = _row(state, self._run.solver.accuracy)
            for name, place in row_of(self._rows, self._kept, n).items():
                place[...] = row[name]
            if n in self._kept:
                self._checkpoint[0] = n

    def finish(self, seconds: dict[str, float], work_begun: float) -> Trajectory:
        """The trajectory of a run that went on from that work."""
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
    """Return views of what the arrays of a trajectory, by name, have of step `n`."""
    row = np.flatnonzero(kept == n).tolist()
    at: dict[str, list[Any]] = {"N": [n], "S": row, "n": [slice(None)] if n == 0 else []}
    return {name: arrays[name][(i, ...)] for name in arrays for i in at[FIELDS[name].sizes[0]]}


def _row(state: State, accuracy: float) -> dict[str, Any]:
    """What a trajectory has of a state, by name."""
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
        "safeguards": state.safeguards,
        "stuck": int(np.count_nonzero(state.sticks)),
        "given_friction": certificate.given_friction,
        "unit": state.unit(accuracy),
    }


def state_of_row(run: PreparedRun, t: float, row: Mapping[str, NDArray[Any]]) -> State:
    """The state at `t` from what a trajectory has of a stored step, or of the initial one.

    That is all that the next step begins from, but for how multipliers have changed last.
    """
    now = StepData.of(run.condensation, t)
    if "state" not in row:
        return state_given(run, now, np.array(row["initial"]))
    read: dict[str, Any] = {name: np.array(value) if value.ndim else value.item() for name, value in row.items()}
    ledger = Ledger(**{field.name: read[field.name] for field in fields(Ledger)})
    state, m, norms = state_given(run, now, read["state"], ledger), run.operators.count, run.system.norms
    lam, p, weights = (read[name] for name in ("multipliers", "pressures", "weights"))
    # Without dashpots these forces have more digits than the difference of load and K y.
    held = run.operators.multiplier_force(lam[:m], p) if run.system.damping is None else state.unbalanced
    return replace(
        state,
        unbalanced=held,
        weights=weights,
        bound=weights if norms is None else np.append(norms.weights_under(t, p, ledger.slipped[:m]), weights[m:]),
        lam=lam,
        p=p,
        sticks=read["sticking"],
        certificate=replace(state.certificate, equilibrium=read["gap"], floor=read["floor"]),
        ledger=ledger,
        scale=max(read["unit"], ledger.norm),
        iterations=read["iterations"],
    )


def mark(run: PreparedRun, times: Floats, kept: Ints) -> list[int]:
    """Four numbers that stand for a run: its matrices, instants, stored steps and settings, and some of its data."""
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
