"""Errors and warnings for users."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from warnings import WarningMessage, catch_warnings, simplefilter


@contextmanager
def quietly() -> Iterator[list[WarningMessage]]:
    """Record warnings inside the block without showing them."""
    with catch_warnings(record=True) as warned:
        simplefilter("always")
        yield warned


class VemcvxError(Exception):
    """The base class of the errors of this package.

    Examples
    --------
    >>> try:
    ...     vx.Norms(B=np.eye(1), w=-1.0)
    ... except vx.VemcvxError as error:
    ...     print(error)
    Norms: found the weight -1 of norm term 0; it must be >= 0.
    """


class MeshError(VemcvxError):
    """The mesh or the mesh file is not valid."""


class MeshWarning(UserWarning):
    """The mesh was corrected: cells or faces were reversed, or unused parts were dropped."""


class SceneError(VemcvxError):
    """The scene or its data do not define a well-posed problem."""


class SceneWarning(UserWarning):
    """The scene has a solution that may not be the intended one."""


WARNING_FRACTION = 0.05  # A run warns of larger strains, and of an initial state that jumps by a larger fraction.


class NotAccepted(VemcvxError):
    """The chosen solver does not accept a feature of the program."""


class SolverFailed(SceneError):
    """The solver raised an error, or its answer does not fit the program."""


class HistoryError(VemcvxError):
    """A history cannot be read, written or drawn as requested."""


class ProgramError(VemcvxError):
    """A step's program cannot be read or written as requested."""


class ProblemError(VemcvxError):
    """A problem file, or an option of the command line, is not valid."""


class NotCertified(VemcvxError):
    """The answer to a step misses the requested accuracy.

    Attributes
    ----------
    step, time : int, float
        Number of the step (from 1), and instant.
    reached, asked, floor : float
        Relative energy errors: certified, requested, and due to rounding.

    Examples
    --------
    >>> system = vx.System(K=np.eye(1), load=lambda t: [3.0 * t], norms=vx.Norms(B=np.eye(1), w=1.0))
    >>> try:
    ...     vx.march(system, [0.0, 1.0], solver=vx.OSQP(options={"max_iter": 1}))
    ... except vx.NotCertified as error:
    ...     print(error.step, error.asked)
    1 1e-06
    """

    step: int = 0
    time: float = 0.0
    reached: float = 0.0
    asked: float = 0.0
    floor: float = 0.0

    # Unpickling calls the class with the message only, and sets the attributes afterwards.
    def __init__(self, message: str, **attributes: float):
        super().__init__(message)
        vars(self).update(attributes)
