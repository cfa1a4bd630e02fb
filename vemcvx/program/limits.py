"""One-sided terms: bounds D_j y <= e_j, and their soft kin (D_j y - e_j)_+^2 / (2 c_j)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.arguments import called, function
from vemcvx.arrays import Floats, MatrixLike, shaped
from vemcvx.errors import SceneError
from vemcvx.outline import ArrayRecord
from vemcvx.program.checks import SAY, at_instant, checked_matrix, finite


@dataclass(frozen=True, repr=False)
class Limits(ArrayRecord):
    """Row j of D, the limit e_j and the compliance c_j.

    With z_j = D_j y - e_j: a bound z_j <= 0 where c_j = 0; the energy (z_j)_+^2 / (2 c_j) where c_j > 0. The multiplier
    p_j >= 0 is the force with which the limit answers, z_j <= c_j p_j with equality where p_j > 0.

    Parameters
    ----------
    D : (r, n) array or sparse matrix
    e : (r,) array, or callable t -> (r,)
    compliance : number or (r,) array
        Displacement per force, >= 0.
    places : callable j -> str, optional
        Where limit j acts, in words, for messages.
    """

    D: sp.csr_matrix
    e: ArrayLike | Callable[[float], ArrayLike]
    compliance: ArrayLike = 0.0
    places: Callable[[int], str] | None = None

    if TYPE_CHECKING:  # D is given as any matrix

        def __init__(
            self,
            D: MatrixLike,
            e: ArrayLike | Callable[[float], ArrayLike],
            compliance: ArrayLike = 0.0,
            places: Callable[[int], str] | None = None,
        ) -> None: ...

    def __post_init__(self) -> None:
        object.__setattr__(self, "D", checked_matrix(self.D, "Limits: D"))
        compliance = self.compliances
        if (compliance < 0).any():
            j = int(np.argmin(compliance))
            raise SceneError(f"Limits: found the compliance {compliance[j]:.6g} of {self.name(j)}; it must be >= 0.")
        object.__setattr__(self, "compliance", compliance)
        function(self.places, "Limits: found places", "a function of j that says where limit j acts")
        if not callable(self.e):
            object.__setattr__(self, "e", self._shaped(self.e, "Limits: e"))

    @property
    def compliances(self) -> Floats:
        """c (r,)."""
        return self._shaped(self.compliance, "Limits: compliance")

    @property
    def count(self) -> int:
        """The number of limits r."""
        return self.D.shape[0]

    def name(self, j: int) -> str:
        """Where limit `j` acts, in words."""
        return f"limit {j}" if self.places is None else str(called(self.places, (j,), "Limits: places failed", SAY))

    def remaining_gap(self, t: float) -> Floats:
        """e (r,) at the instant `t`."""
        e = self.e
        # An array was checked when it was given.
        return e if isinstance(e, np.ndarray) else self._shaped(at_instant(e, t, "Limits: e"), "Limits: e")

    def _shaped(self, raw: ArrayLike, subject: str) -> Floats:
        wanted = f"a number, or ({self.count},) of them, one a limit"
        values = finite(shaped(raw, subject, wanted, (), (self.count,)), subject)
        return np.array(np.broadcast_to(values, (self.count,)))
