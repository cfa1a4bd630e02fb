"""What kind of thing a setting must be, and how a user's functions are called: one sentence for each kind of mistake.

Numbers in arrays are read by :mod:`vemcvx.arrays`. Truth is asked of nothing but flags, equality of nothing but words:
what a user hands in may answer both with an array, or with an error.
"""

from __future__ import annotations

import inspect
import numbers
from collections.abc import Callable, Sequence
from typing import Any, TypeGuard

import numpy as np

from vemcvx.arrays import Array, brief, read_only
from vemcvx.errors import SceneError, VemcvxError

LARGEST = float(np.finfo(float).max)


def flag(raw: Any, name: str) -> bool:
    """True or False, and nothing that merely counts as such: "False" would be true."""
    if not isinstance(raw, (bool, np.bool_)):
        raise SceneError(f"{name}: found {brief(raw)}; wanted True or False.")
    return bool(raw)


def whole(raw: Any, subject: str, name: str, of: str, least: int = 1) -> int:
    """A whole number of something, at least `least`."""
    if not is_whole(raw) or raw < least:
        raise SceneError(f"{subject}: found {name} = {brief(raw)}; it is a whole number of {of}, at least {least}.")
    return int(raw)


def is_whole(raw: object) -> TypeGuard[int]:
    """Whether it is a whole number; neither a flag nor a time span, which numpy counts among them."""
    return isinstance(raw, numbers.Integral) and not isinstance(raw, (bool, np.timedelta64))


def is_real(raw: object) -> TypeGuard[float]:
    """Whether it is a real number, finite or not; neither a flag nor a time span."""
    return isinstance(raw, numbers.Real) and not isinstance(raw, (bool, np.timedelta64))


def part(raw: Any, subject: str, name: str, what: str, example: str) -> float:
    """A number between 0 and 1."""
    if not is_real(raw) or not 0 < raw < 1:
        raise SceneError(f"{subject}: found {name} = {brief(raw)}; it is {what} between 0 and 1, such as {example}.")
    return float(raw)


def number(raw: Any, found: str, wanted: str) -> float:
    """A finite number; `found` says what was asked for, such as "energy_distance: found time"."""
    if not is_real(raw) or not abs(raw) <= LARGEST:
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
    if raw is not None and not callable(raw):
        raise SceneError(f"{found} = {brief(raw)}; wanted {wanted}, or None.")
    return raw


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
    """function(*arguments), arrays among them read-only; or a SceneError that says how it failed.

    A function that ends the process, or runs out of memory, fails like any other.
    """
    try:
        return function(*(sealed(x) if isinstance(x, np.ndarray) else x for x in arguments))
    except VemcvxError:
        raise
    except (Exception, SystemExit) as error:
        words = " ".join(str(error).split()).rstrip(".")
        raise SceneError(f"{failed}: {type(error).__name__}: {words}. It must {wanted}.") from error


def sealed(x: Array) -> Array:
    """The same numbers, for somebody else to read."""
    return read_only(x.view())
