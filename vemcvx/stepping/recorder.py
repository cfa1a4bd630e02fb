"""Steps that are kept: recovered on all unknowns, refined where factors lost digits, certified on the full system."""

from __future__ import annotations

import logging
import time
import zlib
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeGuard

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.archives import Arrays
from vemcvx.arrays import EPS, Bools, Floats, Ints, brief, is_whole, sizes_of
from vemcvx.errors import HistoryError, SceneError
from vemcvx.program.certificate import limit_gaps, norm_gaps
from vemcvx.program.iterative_refinement import full_certificate, refined, residual
from vemcvx.program.operators import Operators
from vemcvx.program.tolerances import INTERIOR
from vemcvx.solvers.newton import Shifts
from vemcvx.stepping.checkpoint import check_same, check_same_data, fixed_marks, from_arrays, mark_of_data, to_arrays
from vemcvx.stepping.ledger import Rubbed, advance_in_full
from vemcvx.stepping.posed_step import PosedStep, require_certified, say_floor
from vemcvx.stepping.state import PreparedRun, State, sticking
from vemcvx.stepping.trajectory import Storage, Trajectory


def refined_state(attempt: PosedStep, state: State) -> State:
    """The state after iterative refinement against the original K; slips, ledger and certificate are those of it."""
    run, before, operators = attempt.run, attempt.before, attempt.run.operators
    remaining_gap, retained = state.data.remaining_gap, run.condensation.retained
    force, lam = state.data.force.phi - run.system.B.T @ state.data.bias, state.lam - attempt.bias
    stick = np.linalg.norm(lam + Shifts.of(operators).norms[:, None] * state.slip, axis=1) <= state.weights
    y = run.condensation.recover(state.y, state.data.force)
    held = {"gap": remaining_gap, "lam": lam, "p": state.p, "stick": stick, "slip": state.slip}
    y, lam, p = refined(run.condensation, operators, force, y, **held)
    lam, p = replace(attempt.program, w=state.weights).project(lam), np.maximum(p, 0.0)
    # What was free to move may have moved a rounding error beyond its bound.
    bounds, beyond = operators.compliance == 0, operators.limits.read(y[retained]) - remaining_gap
    y[retained[operators.limits.columns]] -= np.where(bounds, np.maximum(beyond, 0.0), 0.0) / operators.D.data
    # Sticking terms keep their slip to the last bit; slipping ones may have lost their direction to rounding.
    slip = state.slip + operators.blocks(operators.rows.read(y[retained] - state.y))
    aligned = _aligned(attempt.run.operators, state.weights, lam=lam, slip=slip, stick=stick)
    y[retained[operators.rows.columns]] += (aligned - slip).ravel() / operators.B.data
    slip, moved, excess = aligned, y[retained] - state.y, operators.limits.read(y[retained]) - remaining_gap
    over = limit_gaps(operators.compliance, p, excess, EPS * (np.abs(remaining_gap) + np.abs(excess)))
    # Bounds that act are as far as they were; what their difference of two places says of that is rounding.
    acts = bounds & (state.p > 0)
    over[acts] = state.certificate.limits[acts] * (p[acts] / state.p[acts])
    # Where weights depend on the answer its distance to a solution stays; else the gap of what is refined says all.
    away = state.certificate.distance if run.system.follows_answer else 0.0
    friction, forces = norm_gaps(state.weights, lam, slip), run.system.multiplier_force(lam, p)
    lam = lam + attempt.bias
    own = replace(state.certificate, equilibrium=0.0, friction=friction, limits=over, distance=away, moved=0.0)
    answer = state.answer(state.y - before.y + moved, lam, p)
    between, ends = (before.data, state.data), (before.unknowns, y)
    rubbed = Rubbed(lam, slip, (before.weights, state.weights), (before.bias, state.bias))
    ledger = advance_in_full(run.system, before.ledger, between, ends, answer=answer, rubbed=rubbed)
    return replace(
        state,
        y=y[retained],
        full=y,
        unbalanced=operators.multiplier_force(lam, p),
        lam=lam,
        p=p,
        slip=slip,
        certificate=full_certificate(run.condensation, force, y, forces, own),
        ledger=ledger,
        scale=float(np.maximum(before.scale, ledger.norm)),
    )


def posed_sharply(attempt: PosedStep, refined: State) -> PosedStep:
    """The step posed with the forces g on the retained unknowns that a refined state balances.

    g = K d + B'lam + D'p plus the reduced residual. On weak springs the response x to a load is large, and g = S x_c
    carries the rounding of S times that: too much for sets and pressures.
    """
    run, d = attempt.run, refined.y - attempt.before.y
    held = run.system.multiplier_force(refined.lam, refined.p)
    r = residual(attempt.data.force.phi, run.system.K, refined.unknowns, held)
    left = run.condensation.reduce(r, remembered=False)
    g = refined.unbalanced + run.operators.force(d) + left.retained - run.operators.rows.force_of(attempt.data.bias)
    return replace(attempt, program=replace(attempt.program, g=g))


def _aligned(operators: Operators, w: Floats, lam: Floats, slip: Floats, stick: Bools) -> Floats:
    """Slips (m, block) that point where their multipliers do, but for those that stick.

    Turning a slip by e costs an energy of about e^2 / 2 over the term's flexibility. A slip whose gap is smaller than
    that is left as it is: where contact is open, the direction of a multiplier is that of rounding.
    """
    square = np.einsum("ij,ij->i", lam, lam)
    share = np.divide(np.einsum("ij,ij->i", lam, slip), square, out=np.zeros_like(square), where=square > 0)
    turned = np.where(square[:, None] > 0, np.maximum(share, 0.0)[:, None] * lam, slip)
    cost = 0.5 * np.einsum("ij,ij->i", turned - slip, turned - slip)
    stays = stick | (cost >= operators.norm_flexibility * norm_gaps(w, lam, slip))
    return np.where(stays[:, None], slip, turned)


log = logging.getLogger("vemcvx")

BETWEEN = 1.0
"""Seconds after which a checkpoint is made at a step that is not stored."""


def stored_steps(store: str | int | Sequence[int], steps: int) -> Ints:
    """Step numbers to keep: "all", "last", every `store`-th and the last, or those given and the last."""
    if isinstance(store, str) and store == "all":
        return np.arange(steps + 1)
    if isinstance(store, str) and store == "last":
        return np.array([steps])
    if is_whole(store) and store >= 1:
        return np.unique(np.append(np.arange(0, steps + 1, min(store, steps + 1)), steps))
    if _numbers(store, steps):
        return np.unique(np.append(np.asarray(store, dtype=np.int64), steps))
    raise SceneError(
        f"store: found {brief(store)}; there are 'all', 'last', an integer n >= 1 (every n-th and the last), or a "
        f"sequence of step numbers from 0 to {steps}."
    )


def _numbers(store: object, steps: int) -> TypeGuard[Sequence[int]]:
    if isinstance(store, np.ndarray):
        return store.ndim == 1 and _numbers(store.tolist(), steps)
    if not isinstance(store, Sequence) or isinstance(store, (str, bytes)):
        return False
    return all(is_whole(n) and 0 <= n <= steps for n in store)


def certified_in_full(run: PreparedRun, state: State, lost: sp.csr_matrix | None = None) -> State:
    """The state with all its unknowns and the certificate of the full system; `lost` is the rounding error of K."""
    if state.full is not None:
        return state
    y = run.condensation.recover(state.y, state.data.force)
    # The bias is on both sides, lest its own rounding be none where the two cancel.
    own, bias = state.certificate, run.system.B.T @ state.data.bias
    force = (state.data.force.phi if lost is None else state.data.force.phi - lost @ y) - bias
    held = run.system.multiplier_force(state.lam, state.p) - bias
    if run.system.follows_answer:
        held = -bias
        held[run.condensation.retained] += state.unbalanced
    full = full_certificate(run.condensation, force, y, held, own)
    if full.error > INTERIOR * run.accuracy * state.unit(run.accuracy) and len(state.y) < run.system.n:
        r = residual(force, run.system.K, y, held)
        y = run.condensation.refine_interior(y, r)
        full = full_certificate(run.condensation, force, y, held, own)
    equilibrium, floor = np.maximum([full.equilibrium, full.floor], [own.equilibrium, own.floor]).tolist()
    return replace(state, full=y, certificate=replace(own, equilibrium=equilibrium, floor=floor))


FIELDS = sizes_of(Trajectory)
SCALARS = {name: kind for name, (sizes, kind) in FIELDS.items() if sizes == ("N",) and name != "times"}
TYPES: dict[str, type] = {"f": float, "i": np.int64, "b": bool}
EVERY_STEP = ("scalars", "data", "initial")
"""Arrays with a row for every step, or for the initial instant alone; the others have one for every stored step."""


def _scalars(state: State, sticks: Bools, accuracy: float) -> dict[str, float]:
    """The scalars that a trajectory has of every step; `sticks` (terms,) marks zero increments."""
    certificate, ledger = state.certificate, state.ledger
    return {
        "energy": ledger.energy,
        "dissipated": ledger.dissipated,
        "dissipated_second_order": ledger.dissipated_second_order,
        "work": ledger.work,
        "norm": ledger.norm,
        "gap": certificate.gap,
        "floor": certificate.floor,
        "iterations": state.iterations,
        "safeguards": state.safeguards,
        "contraction": state.rate,
        "stuck": sticks.sum(),
        "estimated": certificate.estimate,
        "unit": state.unit(accuracy),
    }


def _row(state: State, sticks: Bools) -> dict[str, ArrayLike]:
    """The arrays of a stored step; terms that are dragged come last."""
    ledger, dragged = state.ledger, state.dragged
    return {
        "state": state.unknowns,
        "multipliers": np.concatenate([state.lam, dragged.lam]),
        "pressures": state.p,
        "weights": np.concatenate([state.weights, dragged.weights]),
        "sticking": sticks,
        "worn": np.concatenate([ledger.worn, dragged.worn]),
        "worn_second_order": np.concatenate([ledger.worn_second_order, dragged.worn_second_order]),
        "slipped": np.concatenate([ledger.slipped, dragged.slipped]),
        "velocity": 0.0 if state.velocity is None else state.velocity,
    }


class Recorder:
    """Rows of a trajectory, entered as the march goes on, and checkpoints to go on from.

    Parameters
    ----------
    run : PreparedRun
    times : (N + 1,) array
    kept : (S,) array
        Numbers of the steps to keep.
    storage : Storage
        Where the rows go.
    initial : what :func:`vemcvx.stepping.backward_euler.initial_state` takes
        A run goes on only where it began.
    """

    def __init__(self, run: PreparedRun, times: Floats, kept: Ints, storage: Storage, initial: ArrayLike | str | None):
        self._run, self._times, self._kept, self._storage = run, times, kept, storage
        self._row = {int(n): row for row, n in enumerate(kept)}
        self._marks = fixed_marks(run, times, kept, initial) if storage.lasting else {}
        self._sums = dict.fromkeys(self._shapes, 0)
        self._saved = time.perf_counter()

    @property
    def _shapes(self) -> dict[str, tuple[tuple[int, ...], type]]:
        operators, system = self._run.operators, self._run.system
        sizes = {
            "S": len(self._kept),
            "n": system.n,
            "terms": operators.count + (0 if system.dragged is None else system.dragged.count),
            "block": operators.block if system.dragged is None else system.dragged.block,
            "limits": len(operators.compliance),
        }
        stored = {
            name: (tuple(sizes[size] for size in names), TYPES[kind])
            for name, (names, kind) in FIELDS.items()
            if names[0] == "S" and name != "stored" and not (name == "velocity" and system.damping is None)
        }
        return {
            **stored,
            "scalars": ((len(self._times), len(SCALARS)), float),
            "initial": ((1, system.n), float),
            "data": ((len(self._times) if self._storage.lasting else 0,), np.int64),
        }

    def begin(self) -> tuple[int, State] | None:
        """The last step that an earlier run completed and its state, if there was one.

        Raises
        ------
        HistoryError
            The storage holds another run, or rows of it are missing.
        """
        arrays = self._storage.load()
        if arrays is None:
            return None
        check_same(self._marks, arrays)
        self._rows = {name: self._storage.kept(name, *shape) for name, shape in self._shapes.items()}
        n, state = from_arrays(self._run, self._times, arrays)
        self._sums = self._checked_sums(n, arrays)
        check_same_data(self._run.system, self._times, self._rows["data"][: n + 1])
        log.info("going on after step %d of %d, at t = %g", n, len(self._times) - 1, state.t)
        return n, state

    def _checked_sums(self, n: int, arrays: Arrays) -> dict[str, int]:
        """Check sums of the rows up to step `n`, which must be those of the run that wrote them."""
        stored, sums = int(np.searchsorted(self._kept, n, side="right")), dict.fromkeys(self._rows, 0)
        kept = dict(zip(self._rows, arrays["sums"].tolist(), strict=False))
        for name, rows in self._rows.items():
            for row in rows[: n + 1 if name in EVERY_STEP else stored]:
                sums[name] = zlib.crc32(row.tobytes(), sums[name])
            if sums[name] != kept.get(name):
                raise HistoryError(
                    f"resume: the file {name}.npy is not as the run has left it: missing, cut short or changed. "
                    "Run without resume."
                )
        return sums

    def add(self, n: int, state: State) -> None:
        """Enter the state after step `n`; with the initial one, 0, a new run begins.

        Raises
        ------
        NotCertified
            The answer of a kept step does not hold on the full system.
        """
        if n == 0:
            self._storage.clear()
            self._rows = {name: self._storage.array(name, *shape) for name, shape in self._shapes.items()}
        left, stored = state, n in self._row
        if stored or n == 0:
            state = certified_in_full(self._run, state)
            if n > 0 and self._run.check:
                require_certified(self._run, state, n)
        sticks = sticking(self._run, state) if n > 0 else np.ones(len(state.ledger.worn), dtype=bool)
        sticks = np.concatenate([sticks, state.dragged.still])
        scalars = _scalars(state, sticks, self._run.solver.accuracy)
        self._enter(n, "scalars", [scalars[name] for name in SCALARS])
        if n == 0:
            self._enter(0, "initial", state.unknowns)
        if stored:
            values = _row(state, sticks)
            for name in (name for name in self._rows if name not in EVERY_STEP):
                self._enter(self._row[n], name, values[name])
        if self._storage.lasting:
            self._enter(n, "data", mark_of_data(self._run.system, float(self._times[n])))
            self._checkpoint(n, left, stored)

    def _enter(self, row: int, name: str, values: ArrayLike | None) -> None:
        rows = self._rows[name]
        rows[row] = values
        if self._storage.lasting:
            self._sums[name] = zlib.crc32(rows[row].tobytes(), self._sums[name])

    def _checkpoint(self, n: int, state: State, stored: bool) -> None:
        """Keep the state that the next step begins from: at stored steps, and where the last one is long ago."""
        if stored or time.perf_counter() - self._saved > BETWEEN:
            self._storage.save(to_arrays(n, state, self._marks, self._sums))
            self._saved = time.perf_counter()

    def finish(self, seconds: dict[str, float]) -> Trajectory:
        """The trajectory."""
        rows = self._rows
        scalars = {name: np.array(column) for name, column in zip(SCALARS, rows["scalars"].T, strict=True)}
        trajectory = Trajectory(
            times=self._times,
            stored=self._kept,
            **{name: values for name, values in rows.items() if name not in EVERY_STEP},
            initial=rows["initial"][0],
            **{name: column.astype(TYPES[SCALARS[name]]) for name, column in scalars.items()},
            seconds=seconds,
            solver=repr(self._run.solver),
            linear=repr(self._run.condensation.linear),
            accuracy=float(self._run.solver.accuracy),
        )
        say_floor(trajectory.certificate_floor, self._run.solver.accuracy)
        return trajectory
