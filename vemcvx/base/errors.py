"""The errors and warnings a user can meet; every one says what was found, what exists and what to do next."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from warnings import WarningMessage, catch_warnings, simplefilter

LONGEST = 2_000  # Characters of a message: what a user handed in may be quoted in it, whatever its length.


@contextmanager
def quietly() -> Iterator[list[WarningMessage]]:
    """Let nobody hear the warnings that are given within but who has the list of them, which is yielded."""
    with catch_warnings(record=True) as warned:
        simplefilter("always")
        yield warned


class VemcvxError(Exception):
    """Base of every error raised on purpose by this package."""

    def __init__(self, *arguments: object):
        super().__init__(*(_shortened(x) if isinstance(x, str) else x for x in arguments))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle message and attributes: calling the class asks for keywords, which hangs a pool of processes."""
        return _made_again, (type(self), *self.args), self.__dict__


def _shortened(message: str) -> str:
    """A message without its middle, if it is longer than any sentence of ours: its ends say what and what to do."""
    if len(message) <= LONGEST:
        return message
    half = LONGEST // 2
    return f"{message[:half]} ... ({len(message) - 2 * half} characters) ... {message[-half:]}"


def _made_again(kind: type[VemcvxError], *arguments: object) -> VemcvxError:
    return kind.__new__(kind, *arguments)


class MeshError(VemcvxError):
    """The mesh, or the file it was to come from, is not a valid mesh."""


class MeshWarning(UserWarning):
    """The mesh was corrected when it was made: cells or faces turned, unused nodes, inner lines or faces dropped."""


class SceneError(VemcvxError):
    """The scene, its data or the times it is asked for make no well-posed problem."""


class SceneWarning(UserWarning):
    """The scene can be answered, but its answer deserves a second look."""


WORTH_A_WORD = 0.05
"""Part of a size from which what is off by it is said in a warning. Up to strains of that size squares of strains, .1 %
of one, are left out; in 64 steps the problems that come with the package miss turns of their data by less."""


class NotAccepted(VemcvxError):
    """The chosen solver cannot take a term that the program has."""


class SolverFailed(SceneError):
    """The solver broke down: it raised an error of its own, or answered with what fits no program."""


class HistoryError(VemcvxError):
    """A history cannot be read, written or drawn as asked."""


class ProgramError(VemcvxError):
    """A step's program cannot be read or written as asked."""


class ProblemError(VemcvxError):
    """A problem file, or what the command line asks of it, does not make a run."""


class NotCertified(VemcvxError):
    """A step's answer misses the requested accuracy.

    Attributes
    ----------
    step : int
        The step that failed (1 is the first after the initial instant).
    time : float
        Its instant.
    reached, asked, floor : float
        Certified relative energy error: what was reached, rounding included, what was asked, and the part of what was
        reached that round-off alone accounts for.
    """

    def __init__(self, message: str, *, step: int, time: float, reached: float, asked: float, floor: float):
        super().__init__(message)
        self.step, self.time = step, time
        self.reached, self.asked, self.floor = reached, asked, floor
