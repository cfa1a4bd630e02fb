"""Array types, small functions of arrays, and checks of arguments."""

from __future__ import annotations

import contextlib
import inspect
import numbers
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
"""Relative rounding error of sums and products of a few thousand numbers."""
SAME = 1e-9
"""Relative difference below which two numbers count as equal."""
SINGLE_EPS = 1e-6
"""Relative rounding error of numbers in single precision, or of numbers with seven digits."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Array = TypeVar("Array", bound=np.ndarray[Any, Any])

CHUNK_SIZE = 2**12
"""Number of nodes, cells or faces in a batch that fits into the CPU caches."""


def read_only(array: Array) -> Array:
    """Make an array read-only, and return it."""
    array.flags.writeable = False
    return array


def power_of_two(x: Floats | float) -> Floats:
    """Return the smallest power of two above |x|, elementwise; 1 for 0."""
    mantissa, exponent = np.frexp(x)
    return np.ldexp(1.0, np.where(mantissa == 0, 0, exponent))


def lengths(x: Floats) -> Floats:
    """Return the Euclidean length of each row of x (k, components)."""
    return np.abs(x[:, 0]) if x.shape[1] == 1 else np.sqrt(np.einsum("ij,ij->i", x, x))


def directions(x: Floats, size: Floats) -> Floats:
    """Divide each nonzero row of x (k, components) by its length `size` (k,)."""
    return np.sign(x) if x.shape[1] == 1 else x / np.where(size > 0, size, 1.0)[:, None]


def onto_discs(lam: Floats, w: Floats) -> Floats:
    """Project the rows of `lam` (m, block) onto discs with the radii `w` (m,)."""
    if lam.shape[1] == 1:  # Clipping is exact; scaling would round.
        return np.minimum(np.maximum(lam, -w[:, None]), w[:, None])
    size = np.linalg.norm(lam, axis=1)
    scale = np.divide(w, size, out=np.ones_like(size), where=size > w)
    return np.asarray(lam * scale[:, None])


def totals(numbers: Ints, weights: Floats, count: int) -> Floats:
    """Return a vector (count,) with the `weights` added at the indices `numbers`."""
    return np.bincount(numbers, weights, count).astype(float, copy=False)


def sum_columns(values: Floats, numbers: Ints, count: int) -> Floats:
    """Return an array (S, count, ...) with the columns of `values` added at the indices `numbers`."""
    total = np.zeros((len(values), count, *values.shape[2:]))
    np.add.at(total.swapaxes(0, 1), numbers, values.swapaxes(0, 1))
    return total


def are_among(pairs: Ints, known: Ints) -> Bools:
    """Return True for each row of `pairs` (k, 2) that is a row of `known` (e, 2)."""
    return np.isin(pairs @ [1, 1j], known @ [1, 1j])


def as_real_array(raw: Any, subject: str, wanted: str) -> Floats:
    """Convert `raw` into a new array of floats, or raise SceneError."""
    array = plain(raw)
    with contextlib.suppress(Exception), np.errstate(over="ignore"):
        kind = "" if array is None else array.dtype.kind
        if array is not None and (kind in "biuf" or (kind == "O" and all(map(is_real, array.flat)))):
            return array.astype(float)
    raise SceneError(
        f"{subject}: found {brief(raw)}, which does not read as an array of real numbers; wanted {wanted}."
    )


def plain(raw: Any) -> NDArray[Any] | None:
    """Convert `raw` into an array, or return None if the conversion fails or entries are masked."""
    masked = any(isinstance(x, np.ma.MaskedArray) for x in (raw, *(raw if isinstance(raw, (list, tuple)) else ())))
    with contextlib.suppress(Exception):
        return None if masked else np.asarray(raw)
    return None


def largest(values: Floats, part: float) -> Ints:
    """Return the positions of the largest values, which add up to the fraction `part` of the sum."""
    order = np.argsort(-values, kind="stable")
    sums = np.cumsum(values[order])
    return order[: int(np.searchsorted(sums, part * sums[-1])) + 1]


def scatter(values: Floats, rows: Ints, n: int) -> Floats:
    """Return a vector of `n` entries: `values` at the indices `rows`, and zero elsewhere."""
    array = np.zeros(n)
    array[rows] = values
    return array


def drop_tails(value: Callable[[float], Floats], times: Sequence[float]) -> Callable[[float], Floats]:
    """Return a function that sets negligible results of `value` to zero."""

    @cache
    def largest() -> float:
        return max((float(np.abs(value(t)).max(initial=0.0)) for t in times), default=0.0)

    def drop(t: float) -> Floats:
        found = value(t)
        size = float(np.abs(found).max(initial=0.0))
        return np.zeros_like(found) if 0.0 < size < 1e-60 and size < 1e-60 * largest() else found

    return drop


def brief(raw: Any) -> str:
    """Return the representation of `raw`, shortened to one line."""
    return " ".join(reprlib.repr(raw).split())


def as_shaped_array(raw: Any, subject: str, wanted: str, *shapes: tuple[int, ...]) -> Floats:
    """Convert `raw` into a new array of floats with one of the `shapes`, or raise SceneError."""
    array = as_real_array(raw, subject, wanted)
    if array.shape not in shapes:
        raise SceneError(f"{subject}: found {shape_in_words(array)}; wanted {wanted}.")
    return array


def one_point(raw: Any, dim: int, subject: str) -> Floats:
    """Return the finite coordinates (dim,) of a point, or raise SceneError."""
    return finite(as_shaped_array(raw, subject, f"a point of {dim} coordinates", (dim,)), subject)


def shape_in_words(array: Floats) -> str:
    """Describe a single number by its value, and an array by its shape."""
    return f"the single number {array:.6g}" if array.ndim == 0 else f"an array of shape {array.shape}"


class ArrayField(NamedTuple):
    """The axis names of an array, the kind (a letter of NumPy), and the unit."""

    sizes: tuple[str, ...]
    kind: str
    unit: str


def array_fields(record: type) -> dict[str, ArrayField]:
    """Return the ArrayField of each array field of a record, by name.

    Sizes and units come from annotations such as ``stress: Annotated[Floats, "S cells 3", "force/length2"]``.
    """
    found = {}
    for name, hint in get_type_hints(record, include_extras=True).items():
        if hasattr(hint, "__metadata__"):
            (sizes, unit), arrays = hint.__metadata__, (hint.__origin__, *get_args(hint.__origin__))
            kind = "b" if Bools in arrays else "i" if Ints in arrays else "f"
            found[name] = ArrayField(tuple(sizes.split()), kind, unit)
    return found


def flag(raw: Any, name: str) -> bool:
    """Return `raw` as a bool, or raise SceneError."""
    if not isinstance(raw, (bool, np.bool_)):
        raise SceneError(f"{name}: found {brief(raw)}; wanted True or False.")
    return bool(raw)


def whole(raw: Any, subject: str, name: str, of: str) -> int:
    """Return `raw` if it is an integer >= 1, or raise SceneError."""
    if not is_whole(raw) or raw < 1:
        raise SceneError(f"{subject}: found {name} = {brief(raw)}; it is a whole number of {of}, at least 1.")
    return int(raw)


def is_whole(raw: object) -> TypeGuard[int]:
    """Return True for an integer, but not for a boolean or a time span."""
    return isinstance(raw, numbers.Integral) and not isinstance(raw, (bool, np.timedelta64))


def is_real(raw: object) -> TypeGuard[float]:
    """Return True for a real number, but not for a boolean or a time span."""
    return isinstance(raw, numbers.Real) and not isinstance(raw, (bool, np.timedelta64))


def part(raw: Any, subject: str, name: str, what: str, example: str) -> float:
    """Return `raw` as a float between 0 and 1, or raise SceneError."""
    if not is_real(raw) or not 0 < raw < 1:
        raise SceneError(f"{subject}: found {name} = {brief(raw)}; it is {what} between 0 and 1, such as {example}.")
    return float(raw)


def number(raw: Any, found: str, wanted: str) -> float:
    """Return `raw` as a finite float, or raise SceneError."""
    if not is_real(raw) or not abs(raw) <= sys.float_info.max:
        raise SceneError(f"{found} = {brief(raw)}; wanted {wanted}.")
    return float(raw)


def choice(raw: Any, subject: str, name: str, words: Sequence[str], error: type[VemcvxError] = SceneError) -> str:
    """Return `raw` if it is one of `words`, or raise an error."""
    if not isinstance(raw, str) or raw not in words:
        known = ", ".join(map(repr, words[:-1])) + f" and {words[-1]!r}"
        raise error(f"{subject}: found {name} {brief(raw)}; there are {known}.")
    return raw


def instance(raw: Any, kinds: type | tuple[type, ...], found: str, wanted: str) -> Any:
    """Return `raw` if it is None or an instance of `kinds`, or raise SceneError."""
    if raw is not None and not isinstance(raw, kinds):
        raise SceneError(f"{found} = {brief(raw)}; wanted {wanted}, or None.")
    return raw


def function(raw: Any, found: str, wanted: str) -> Any:
    """Return `raw` if it is None or a function, or raise SceneError."""
    return instance(raw, Callable, found, wanted)  # type: ignore[arg-type]


def check_takes(function: Callable[..., object] | None, count: int, subject: str, wanted: str) -> None:
    """Raise SceneError if a function does not take `count` arguments."""
    try:
        inspect.signature(function or (lambda *_: None)).bind(*range(count))
    except TypeError as error:
        raise SceneError(f"{subject}: found {brief(function)}; wanted a function of {wanted}, but {error}.") from None
    except ValueError:
        pass  # Some functions in C have no signature.


def call_function(function: Callable[..., Any], arguments: tuple[Any, ...], failed: str, wanted: str) -> Any:
    """Call a user's function with read-only arrays; raise SceneError if the function fails."""
    try:
        return function(*(read_only(x.view()) if isinstance(x, np.ndarray) else x for x in arguments))
    except VemcvxError:
        raise
    except (Exception, SystemExit) as error:
        words = " ".join(str(error).split()).rstrip(".")
        raise SceneError(f"{failed}: {type(error).__name__}: {words}. It must {wanted}.") from error


def at_instant(data: ArrayLike | Callable[[float], ArrayLike], t: float, subject: str) -> ArrayLike:
    """Return data(t) or constant `data`; raise SceneError if the function fails."""
    if not callable(data):
        return data
    failed = f"{subject}: its function failed when called as f(t) with t = {t:.6g}"
    return call_function(data, (t,), failed, "take an instant and return an array")


def as_sparse_matrix(raw: Any, subject: str, shape: tuple[int, int] | None = None) -> sp.csr_matrix:
    """Convert a matrix into a sparse matrix of finite numbers, or raise SceneError."""
    sparse = sp.issparse(raw)
    if sparse and raw.dtype.kind in "biuf":
        try:
            check_compressed(raw)
        except (ValueError, TypeError, AttributeError) as error:
            raise SceneError(f"{subject}: found a sparse matrix with invalid indices: {error}.") from error
        is_writeable = not isinstance(raw, sp.csr_matrix) or raw.data.flags.writeable
        matrix: sp.csr_matrix = sp.csr_matrix(raw, dtype=np.float64, copy=is_writeable)
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
    """Raise ValueError for invalid indices, which SciPy's compiled code does not check."""
    if not hasattr(matrix, "check_format"):
        return
    matrix.check_format(full_check=True)
    if (matrix.indptr[1:] < matrix.indptr[:-1]).any():
        raise ValueError("the row pointers decrease")


def as_array_of_shape(raw: ArrayLike, subject: str, shape: tuple[int, ...]) -> Floats:
    """Return an array of real numbers of this shape, from an array or a flat vector."""
    return as_shaped_array(raw, subject, f"numbers of shape {shape}", shape, (int(np.prod(shape)),)).reshape(shape)


def finite(values: Floats, subject: str) -> Floats:
    """Return the values, or raise SceneError for NaN or infinity."""
    if not np.isfinite(values).all():
        raise SceneError(f"{subject}: found NaN or infinite values; all must be finite.")
    return values
