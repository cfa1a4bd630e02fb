"""The errors and warnings a user can meet; each says what was found, what exists and what to do next."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from warnings import WarningMessage, catch_warnings, simplefilter


@contextmanager
def quietly() -> Iterator[list[WarningMessage]]:
    """Suppress warnings inside the block and yield the list of those caught."""
    with catch_warnings(record=True) as warned:
        simplefilter("always")
        yield warned


class VemcvxError(Exception):
    """Base of the errors of this package."""


class MeshError(VemcvxError):
    """The mesh, or its file, is not a valid mesh."""


class MeshWarning(UserWarning):
    """The mesh was corrected: cells or faces turned, unused nodes, inner lines or faces dropped."""


class SceneError(VemcvxError):
    """The scene, its data and the times make no well-posed problem."""


class SceneWarning(UserWarning):
    """The scene has an answer that deserves a second look."""


WORTH_A_WORD = 0.05  # Relative deviation above which a warning is issued; of small strains the strain itself.


class NotAccepted(VemcvxError):
    """The chosen solver cannot take a term of the program."""


class SolverFailed(SceneError):
    """The solver raised an error of its own, or its answer does not fit the program."""


class HistoryError(VemcvxError):
    """A history cannot be read, written or drawn as asked."""


class ProgramError(VemcvxError):
    """A step's program cannot be read or written as asked."""


class ProblemError(VemcvxError):
    """A problem file, or an option of the command line, does not make a run."""


class NotCertified(VemcvxError):
    """A step's answer misses the requested accuracy.

    Attributes
    ----------
    step, time : int, float
        The step that failed, 1 for the first one, and its instant.
    reached, asked, floor : float
        Certified relative energy errors: that of the answer, the requested one, and what round-off alone accounts for.
    """

    step: int = 0
    time: float = 0.0
    reached: float = 0.0
    asked: float = 0.0
    floor: float = 0.0

    # A pickle calls the class with the message alone, and sets the attributes then.
    def __init__(self, message: str, **attributes: float):
        super().__init__(message)
        vars(self).update(attributes)
