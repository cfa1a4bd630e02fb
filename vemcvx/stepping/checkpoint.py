"""Checkpoints: the state of an interrupted run, field by field, and marks of the data it was made from.

A checkpoint has every field of the state but the data of the system at that instant, which are evaluated anew. Marks
tell whether a run may go on where another stopped: marks of all that is fixed in time, the system among it, field by
field; and a mark of the data at every instant, compared for the steps already made (steps to come use the data as they
are).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.archives import Arrays, arrays_of, record_of
from vemcvx.arrays import Floats, Ints
from vemcvx.errors import HistoryError, SceneError
from vemcvx.program.operators import Norms
from vemcvx.program.system import DraggedTerms, System
from vemcvx.stepping.state import PreparedRun, State
from vemcvx.version import __version__

DRIVE = "data"  # The one field of a state that is not kept.
SEAL = "seal"


def fixed_marks(run: PreparedRun, times: Floats, kept: Ints, initial: object) -> Arrays:
    """Marks of what two runs must share if one is to go on where the other stopped, by what users call it."""
    condensation = run.condensation
    return {
        "version": _mark(__version__),
        "scene or mesh": _mark(run.system),
        "times": _mark(times),
        "store": _mark(kept),
        "solver": _mark(repr(_plain(run.solver))),
        "condense or linear": _mark(condensation.retained, repr(_plain(condensation.linear))),
        "initial": _mark(initial),
    }


def mark_of_data(system: System, t: float) -> int:
    """A number that stands for all that drives the system at an instant."""
    norms, dragged, damping = system.norms, system.dragged, system.damping
    parts = [system.force(t), system.remaining_gap(t)]
    if norms is not None:
        parts += [norms.bias_at(t), norms.weights(t), norms.moved(t)]
        parts += _followed(system, norms.weights_under, t, norms) if system.follows_answer else []
    if dragged is not None:
        parts += [dragged.position(t), *_followed(system, dragged.weights, t, dragged)]
        parts += [] if dragged.bias is None else [dragged.bias(t)]
    for motion in (system.motion, None if damping is None else damping.motion):
        if motion is not None:
            parts += [motion.dirichlet_force(t), motion.prescribed_slip(t), np.array(motion.stored(t, t))]
            parts += [motion.frame(t, np.zeros(system.n))]
            parts += [] if motion.remaining_gap is None else [motion.remaining_gap(t)]
    return int(_mark(*parts)[0])


def _followed(system: System, weights: Callable[..., Floats], t: float, terms: Norms | DraggedTerms) -> list[Floats]:
    """Weights (m,) as they follow forces and slips; none where a law refuses what need not come up.

    Nodal forces of some sizes show cohesion, coefficient, cap and most tables; likewise slips before a step, and in it.
    """
    found = []
    for size in (0.0, 1e-150, *10.0 ** np.arange(-6, 13, 3), 1e150):
        for slip in (0.0, 1e-9, 1e-6, 1e-3, 1.0) if terms.remembers else (0.0,):
            slips = np.full(terms.count, slip)
            with suppress(SceneError):
                found.append(weights(t, np.full(system.D.shape[0], size), slips, slips))
    return found


def _mark(*parts: object) -> Ints:
    """Two numbers that stand for arrays, words, and records of such; functions are not looked into."""
    made = hashlib.blake2b(digest_size=16)
    for part in parts:
        for piece in _pieces(part):
            made.update(piece)
    return np.frombuffer(made.digest(), dtype=np.int64)


def _pieces(value: Any) -> Iterator[bytes]:
    sparse = sp.issparse(value)
    if sparse:
        yield from _pieces((value.shape, *(np.asarray(part) for part in (value.data, value.indices, value.indptr))))
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape}:".encode()
        yield np.ascontiguousarray(value).tobytes()
    elif callable(value):
        yield b"function;"
    elif is_dataclass(value):
        for field in fields(value):
            yield f"{field.name}=".encode()
            yield from _pieces(getattr(value, field.name))
    elif isinstance(value, (tuple, list)):
        for part in value:
            yield from _pieces(part)
    else:
        yield f"{value!r};".encode()


def _plain(settings: object) -> object:
    """Settings with a repr that says the same in every process."""
    own = type(settings).__repr__ is not object.__repr__
    return settings if own else (type(settings).__qualname__, sorted(vars(settings).items()))


def check_same(marks: Arrays, arrays: Arrays) -> None:
    """Raise HistoryError when a checkpoint is not whole, or belongs to another run."""
    if not np.array_equal(_seal(arrays), arrays.get(SEAL, ())):
        raise HistoryError("checkpoint: incomplete, or changed since it was made. Remove the folder and run again.")
    kept = dict(zip(marks, arrays["marks"], strict=False))
    other = [name for name, mark in marks.items() if not np.array_equal(mark, kept.get(name, ()))]
    if other:
        raise HistoryError(
            f"resume: the folder holds a run of another scene, mesh, times or store, or with other settings (what "
            f"differs: {', '.join(other)}). Resume with what it was begun with, or choose an empty folder."
        )


def check_same_data(system: System, times: Floats, marks: Ints) -> None:
    """Raise HistoryError when data differ from those of the steps already made, (n + 1,) marks."""
    for t, mark in zip(times, marks, strict=False):
        if mark_of_data(system, float(t)) != mark:
            raise HistoryError(
                f"resume: the folder holds a run of another scene, mesh, times or store (what differs: loads, supports "
                f"or bounds at t = {t:.6g}). Resume with what it was begun with, or choose an empty folder."
            )


def to_arrays(n: int, state: State, marks: Arrays, sums: dict[str, int]) -> Arrays:
    """The state after step `n`, field by field, beside the marks of the run and the check sums of its rows."""
    own = {"numbers": np.array([n, state.t]), "marks": np.array([*marks.values()]), "sums": np.array([*sums.values()])}
    arrays = {**own, **dict(arrays_of(state, DRIVE))}
    return {**arrays, SEAL: _seal(arrays)}


def _seal(arrays: Arrays) -> Ints:
    return _mark([part for name in sorted(arrays) if name != SEAL for part in (name, arrays[name])])


def from_arrays(run: PreparedRun, times: Floats, arrays: Arrays) -> tuple[int, State]:
    """The step number and the state.

    What drove the steps so far is evaluated again in their order: the responses to forces that a condensation remembers
    are then the same, too.
    """
    n = int(arrays["numbers"][0])
    for t in times[: n + 1]:
        driven = run.driven(float(t))
    try:
        return n, record_of(State, arrays, {DRIVE: driven})
    except KeyError as error:
        raise HistoryError(f"checkpoint: of another version, no {error}. Remove the folder and run again.") from error
