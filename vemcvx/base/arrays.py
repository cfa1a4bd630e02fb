"""Types of arrays, sums and lengths, and checks of what users hand in: one sentence for each kind of mistake."""

from __future__ import annotations

import contextlib
import inspect
import math
import numbers
import re
import reprlib
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple, TypeGuard, TypeVar, get_args, get_type_hints

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.errors import SceneError, VemcvxError

EPS = float(np.finfo(float).eps)
ROUNDING = 1e-12
"""Part of the largest among them below which sums and products of a few thousand numbers differ by their rounding."""
SAME = 1e-9
"""Part of the largest within which two results are one that were found in different ways, by solves or in geometry:
these leave 1e-12 to 1e-11 of it."""
SINGLE = 1e-6
"""Part of the size of a cell by which coordinates in single precision, or printed with seven digits, may be off."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
MatrixLike = ArrayLike | sp.sparray | sp.spmatrix  # A matrix as users give it, dense or sparse.
Array = TypeVar("Array", bound=np.ndarray[Any, Any])

SOME = 2**12
"""Things that are treated at a time: their arrays stay in the caches, which takes half the time of a million faces at
once. The rows of a matrix that so many nodes of a block of cubes have hold 1e6 entries."""


def read_only(array: Array) -> Array:
    """The same array, which from now on refuses to be written to."""
    array.flags.writeable = False
    return array


def power_of_two(x: Floats | float) -> Floats:
    """The power of two next above |x|, elementwise; 1 for 0."""
    if isinstance(x, float):  # Four a step, in a quarter of the time that arrays of one number take.
        return np.ldexp(1.0, math.frexp(x)[1] if x else 0)
    mantissa, exponent = np.frexp(x)
    return np.ldexp(1.0, np.where(mantissa == 0, 0, exponent))


def lengths(x: Floats) -> Floats:
    """The Euclidean length of each row of x (k, components)."""
    # |x| takes a fifth of the time of a norm, of which a step in the plane takes a few, and NumPy's own three times it.
    return np.abs(x[:, 0]) if x.shape[1] == 1 else np.sqrt(np.einsum("ij,ij->i", x, x))


def directions(x: Floats, size: Floats) -> Floats:
    """The rows of x (k, components) over their lengths `size` (k,); zero where these are."""
    return np.sign(x) if x.shape[1] == 1 else x / np.where(size > 0, size, 1.0)[:, None]


def onto_discs(lam: Floats, w: Floats) -> Floats:
    """The vectors (m, block) nearest to `lam` with |lam_i| <= w_i."""
    if lam.shape[1] == 1:
        # The projection onto an interval is exact; scaling would leave one rounding error.
        return np.minimum(np.maximum(lam, -w[:, None]), w[:, None])
    size = np.linalg.norm(lam, axis=1)
    scale = np.divide(w, size, out=np.ones_like(size), where=size > w)
    return np.asarray(lam * scale[:, None])


def totals(numbers: Ints, weights: Floats, count: int) -> Floats:
    """The sum of the weights that go with each number below `count`."""
    return np.bincount(numbers, weights, count).astype(float, copy=False)


def summed_columns(values: Floats, numbers: Ints, count: int) -> Floats:
    """Columns of values (S, k, ...) with the same number below `count` added up: (S, count, ...)."""
    total = np.zeros((len(values), count, *values.shape[2:]))
    np.add.at(total.swapaxes(0, 1), numbers, values.swapaxes(0, 1))
    return total


def as_real_array(raw: Any, subject: str, wanted: str) -> Floats:
    """A new array of the floats, finite or not, that `raw` holds, or SceneError.

    Numpy would read "1" as 1, None as NaN, time spans and masked entries as numbers, and drop imaginary parts: all are
    refused.
    """
    if type(raw) is np.ndarray and raw.dtype == np.float64:
        return raw.astype(float)
    array = plain(raw)
    with contextlib.suppress(Exception), np.errstate(over="ignore"):
        kind = "" if array is None else array.dtype.kind
        if array is not None and (kind in "biuf" or (kind == "O" and all(map(is_real, array.flat)))):
            return array.astype(float)
    raise SceneError(
        f"{subject}: found {brief(raw)}, which does not read as an array of real numbers; wanted {wanted}."
    )


def plain(raw: Any) -> NDArray[Any] | None:
    """The array that `raw` is or makes; None where it makes none, whatever its error, or has masked entries."""
    with contextlib.suppress(Exception):
        return None if _masked(raw) else np.asarray(raw)
    return None


def _masked(raw: Any) -> bool:
    """Return True if a value has masked entries, at any depth of lists."""
    if isinstance(raw, (list, tuple)):
        return any(map(_masked, raw))
    return isinstance(raw, np.ma.MaskedArray)


def largest(values: Floats, part: float) -> Ints:
    """The numbers of the fewest values (k,), none negative, that make up this part of their sum; the largest first."""
    order = np.argsort(-values, kind="stable")
    sums = np.cumsum(values[order])
    return order[: int(np.searchsorted(sums, part * sums[-1])) + 1]


def spread(values: Floats, rows: Ints, n: int) -> Floats:
    """The vector (n,) with these values on some rows, and zero elsewhere."""
    array = np.zeros(n)
    array[rows] = values
    return array


def columns(arrays: Sequence[Floats], count: int) -> Floats:
    """Vectors (n,) beside each other as the first columns of an array (n, count), zero elsewhere."""
    beside = np.zeros((len(arrays[0]), count), order="F")
    for k, array in enumerate(arrays):
        beside[:, k] = array
    return beside


def by_rows(made: Callable[[int, int], sp.csr_matrix], n: int, most: int, shape: tuple[int, int]) -> sp.csr_matrix:
    """The matrix whose rows are made for SOME of n things at a time, and no copy of it is ever beside it.

    `most` are the entries that it has at most, if that is known, and 0 otherwise.
    """
    kind: np.dtype[np.int32 | np.int64] = np.dtype(np.int32 if max(most, *shape) < 2**31 else np.int64)
    data, indices, indptr, row = np.empty(most), np.empty(most, kind), np.zeros(shape[0] + 1, np.int64), 0
    for start in range(0, n, SOME):
        rows = made(start, min(start + SOME, n))
        begin, stop = indptr[row], row + rows.shape[0]
        if begin + rows.nnz > len(data):  # Pieces kept to be joined leave gaps: .3 GB of 1e6 unknowns.
            for entries in (data, indices):
                entries.resize(begin + rows.nnz, refcheck=False)
        data[begin : begin + rows.nnz], indices[begin : begin + rows.nnz] = rows.data, rows.indices
        indptr[row : stop + 1] = begin + rows.indptr
        row = stop
    for entries in (data, indices):
        entries.resize(indptr[-1], refcheck=False)  # Nothing else refers to them.
    return sp.csr_matrix((data, indices, indptr), shape=shape)


def fading(value: Callable[[float], Floats], times: Sequence[float]) -> Callable[[float], Floats]:
    """A datum in time, zero where it is less than 1e-60 of its largest value at the instants of a run.

    Before and after a pulse exp(-x^2) is such a datum, 1e-150 at x = 18.6: energies of it are no numbers beside others.
    """

    @cache
    def largest() -> float:
        return max((float(np.abs(value(t)).max(initial=0.0)) for t in times), default=0.0)

    def faded(t: float) -> Floats:
        found = value(t)
        # Whatever the units are, few data are as small as that; of those alone the others are asked.
        if float(np.vdot(found, found)) > 1e-120:
            return found
        size = float(np.abs(found).max(initial=0.0))
        return np.zeros_like(found) if 0.0 < size < 1e-60 and size < 1e-60 * largest() else found

    return faded


def brief(raw: Any) -> str:
    """`raw` in at most a line."""
    return " ".join(reprlib.repr(raw).split())


def shaped(raw: Any, subject: str, wanted: str, *shapes: tuple[int, ...]) -> Floats:
    """A new array of the floats that `raw` holds, of one of some shapes."""
    array = as_real_array(raw, subject, wanted)
    if array.shape not in shapes:
        raise SceneError(f"{subject}: found {shape_in_words(array)}; wanted {wanted}.")
    return array


def shape_in_words(array: Floats) -> str:
    """The words for what was found where a shape is wrong."""
    return f"the single number {array:.6g}" if array.ndim == 0 else f"an array of shape {array.shape}"


class Quantity(NamedTuple):
    """An array of a record: names of its sizes, numpy's letter for its kind, its unit, and its meaning in words."""

    sizes: tuple[str, ...]
    kind: str
    unit: str
    meaning: str


def quantities(record: type) -> dict[str, Quantity]:
    """Return the arrays among the fields of a record by name: the one list that files, tables and datasets go by.

    Annotations say sizes and unit, as ``stress: Annotated[Floats, "S cells 3", "force/length2"]`` with its last size
    given, and attributes in the docstring the meaning.
    """
    said = re.findall(r"^(\w+(?:, \w+)*) : .*\n((?:    .*\n?)*)", inspect.getdoc(record) or "", flags=re.MULTILINE)
    meaning = {name: " ".join(words.split()) for names, words in said for name in names.split(", ")}
    found = {}
    for name, hint in get_type_hints(record, include_extras=True).items():
        if hasattr(hint, "__metadata__"):
            (sizes, unit), arrays = hint.__metadata__, (hint.__origin__, *get_args(hint.__origin__))
            kind = "b" if Bools in arrays else "i" if Ints in arrays else "f"
            found[name] = Quantity(tuple(sizes.split()), kind, unit, meaning.get(name, ""))
    return found


# Truth is asked of nothing but flags, equality of nothing but words: other values may answer with arrays or errors.
def flag(raw: Any, name: str) -> bool:
    """True or False; other values are refused, as "False" would be true."""
    if not isinstance(raw, (bool, np.bool_)):
        raise SceneError(f"{name}: found {brief(raw)}; wanted True or False.")
    return bool(raw)


def whole(raw: Any, subject: str, name: str, of: str, least: int = 1) -> int:
    """A whole number of something, at least `least`."""
    if not is_whole(raw) or raw < least:
        raise SceneError(f"{subject}: found {name} = {brief(raw)}; it is a whole number of {of}, at least {least}.")
    return int(raw)


def is_whole(raw: object) -> TypeGuard[int]:
    """Return True if a value is a whole number; flags and time spans, which numpy counts among them, are none."""
    return isinstance(raw, numbers.Integral) and not isinstance(raw, (bool, np.timedelta64))


def is_real(raw: object) -> TypeGuard[float]:
    """Return True if a value is a real number, finite or not; flags and time spans are none."""
    return isinstance(raw, numbers.Real) and not isinstance(raw, (bool, np.timedelta64))


def part(raw: Any, subject: str, name: str, what: str, example: str) -> float:
    """A number between 0 and 1."""
    if not is_real(raw) or not 0 < raw < 1:
        raise SceneError(f"{subject}: found {name} = {brief(raw)}; it is {what} between 0 and 1, such as {example}.")
    return float(raw)


def number(raw: Any, found: str, wanted: str) -> float:
    """A finite number; `found` says what was asked for, such as "energy_distance: found time"."""
    if not is_real(raw) or not abs(raw) <= sys.float_info.max:
        raise SceneError(f"{found} = {brief(raw)}; wanted {wanted}.")
    return float(raw)


def choice(raw: Any, subject: str, name: str, words: Sequence[str], error: type[VemcvxError] = SceneError) -> str:
    """One of some words."""
    if not isinstance(raw, str) or raw not in words:
        known = ", ".join(map(repr, words[:-1])) + f" and {words[-1]!r}"
        raise error(f"{subject}: found {name} {brief(raw)}; there are {known}.")
    return raw


def instance(raw: Any, kinds: type | tuple[type, ...], found: str, wanted: str) -> Any:
    """Something of a class, or None; `found` says what was asked for, such as "System: found norms"."""
    if raw is not None and not isinstance(raw, kinds):
        raise SceneError(f"{found} = {brief(raw)}; wanted {wanted}, or None.")
    return raw


def function(raw: Any, found: str, wanted: str) -> Any:
    """A function, or None."""
    return instance(raw, Callable, found, wanted)  # type: ignore[arg-type]


def check_takes(function: Callable[..., object] | None, count: int, subject: str, wanted: str) -> None:
    """Raise SceneError if a function does not take so many arguments, which `wanted` names."""
    if function is None:
        return
    try:
        inspect.signature(function).bind(*range(count))
    except TypeError as error:
        raise SceneError(f"{subject}: found {brief(function)}; wanted a function of {wanted}, but {error}.") from None
    except ValueError:
        pass  # some of those in C do not tell


def called(function: Callable[..., Any], arguments: tuple[Any, ...], failed: str, wanted: str) -> Any:
    """function(*arguments), with read-only arrays; or a SceneError that says how it failed, by SystemExit too."""
    try:
        return function(*(read_only(x.view()) if isinstance(x, np.ndarray) else x for x in arguments))
    except VemcvxError:
        raise
    except (Exception, SystemExit) as error:
        words = " ".join(str(error).split()).rstrip(".")
        raise SceneError(f"{failed}: {type(error).__name__}: {words}. It must {wanted}.") from error


def at_instant(data: ArrayLike | Callable[[float], ArrayLike], t: float, subject: str) -> ArrayLike:
    """data(t), or a SceneError that says how it failed; the data where they are no function."""
    if not callable(data):
        return data
    failed = f"{subject}: its function failed when called as f(t) with t = {t:.6g}"
    return called(data, (t,), failed, "take an instant and return an array")


def checked_matrix(raw: Any, subject: str, shape: tuple[int, int] | None = None) -> sp.csr_matrix:
    """A sparse matrix of finite numbers, from a dense or sparse one; of a shape, if one is given.

    It is a copy, unless nobody may write to the entries of the one given.
    """
    sparse = sp.issparse(raw)
    if sparse and raw.dtype.kind in "biuf":
        if hasattr(raw, "check_format"):
            try:
                check_compressed(raw)
            except (ValueError, TypeError, AttributeError) as error:
                raise SceneError(f"{subject}: found a sparse matrix that leads out of itself: {error}.") from error
        open_to_change = not isinstance(raw, sp.csr_matrix) or raw.data.flags.writeable
        matrix: sp.csr_matrix = sp.csr_matrix(raw, dtype=np.float64, copy=open_to_change)
    else:
        dense = as_real_array(raw, subject, "a matrix of real numbers")
        if dense.ndim != 2:
            raise SceneError(f"{subject}: found {shape_in_words(dense)}; wanted a matrix, dense or sparse.")
        matrix = sp.csr_matrix(dense)
    finite(matrix.data, subject)
    if shape is not None and matrix.shape != shape:
        raise SceneError(f"{subject}: found a matrix of shape {matrix.shape}; wanted {shape}.")
    return matrix


def check_compressed(matrix: sp.csr_matrix) -> None:
    """Raise ValueError for compressed rows or columns that lead out of a matrix: SciPy's compiled code follows them."""
    matrix.check_format(full_check=True)
    # SciPy looks no further where the last end is negative; differences of ends may overflow.
    if (matrix.indptr[1:] < matrix.indptr[:-1]).any():
        raise ValueError("ends of rows go back")


def of_shape(raw: ArrayLike, subject: str, shape: tuple[int, ...]) -> Floats:
    """An array of real numbers of that shape, which may be given flat."""
    return shaped(raw, subject, f"numbers of shape {shape}", shape, (int(np.prod(shape)),)).reshape(shape)


def finite(values: Floats, subject: str) -> Floats:
    """The values, or SceneError for NaN or infinity."""
    if not np.isfinite(values).all():
        raise SceneError(f"{subject}: found NaN or infinite values; all must be finite.")
    return values
