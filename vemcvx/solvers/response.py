"""How what norm terms and limits feel answers to their own forces: all unknowns but the multipliers eliminated.

With A = [B; D] and x = [lam; p], A d = A K^{-1} g - (A K^{-1} A') x. Where K has a kernel, K = K_r - R' diag(a) R with
the stiffness a of the anchors R d, and R joins A as limits of softness -1/a that always act: a body that nothing else
holds costs what any other does.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.program.form import Form

Floats = NDArray[np.float64]


class Response:
    """A K^{-1} A' of a form, and what belongs to its rows A = [B; D; R]: (N, N) with N = m * block + r + anchors."""

    def __init__(self, form: Form):
        n = form.B.shape[1]
        anchored = np.zeros(0, dtype=np.int64) if form.anchor is None else np.flatnonzero(form.anchor)
        R = sp.csr_matrix((np.ones(len(anchored)), (np.arange(len(anchored)), anchored)), shape=(len(anchored), n))
        self.form, self.A = form, sp.csr_matrix(sp.vstack([form.B, form.D, R]))
        self.softness = np.zeros(self.A.shape[0])
        self.norms = slice(0, form.B.shape[0])
        self.limits = slice(form.B.shape[0], form.B.shape[0] + form.D.shape[0])
        self.softness[self.limits] = form.softness
        if len(anchored):
            self.softness[self.limits.stop :] = -1.0 / form.anchor[anchored]  # type: ignore[index]
        self.matrix = self.A @ form.factor.solve(self.A.T.toarray())
        self.absolute = abs(self.A)

    def act(self, x: Floats) -> Floats:
        """A'x, (n,)."""
        return self.A.T @ x
