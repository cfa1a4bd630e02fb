"""How what norm terms and limits feel answers to their own forces: all unknowns but the multipliers eliminated.

With A = [B; D] and x = [lam; p], A d = A K^{-1} g - (A K^{-1} A') x. Where K has a kernel, K = K_r - R' diag(a) R with
the stiffness a of the anchors R d, and R joins A as limits of compliance -1/a that always act: a body that nothing else
holds costs what any other does.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.program.operators import Operators


class Response:
    """A K^{-1} A' for the rows A = [B; D; R] of operators, and its parts: (N, N) with N = m * block + r + anchors."""

    def __init__(self, operators: Operators):
        n = operators.B.shape[1]
        anchor = np.zeros(n) if operators.anchor is None else operators.anchor
        anchored = np.flatnonzero(anchor)
        R = sp.csr_matrix((np.ones(len(anchored)), (np.arange(len(anchored)), anchored)), shape=(len(anchored), n))
        self.operators, self.A = operators, sp.csr_matrix(sp.vstack([operators.B, operators.D, R]))
        self.compliance = np.zeros(self.A.shape[0])
        self.norms = slice(0, operators.B.shape[0])
        self.limits = slice(operators.B.shape[0], operators.B.shape[0] + operators.D.shape[0])
        self.compliance[self.limits] = operators.compliance
        self.compliance[self.limits.stop :] = -1.0 / anchor[anchored]
        self.matrix = self.A @ operators.factor.solve(self.A.T.toarray())
        self.absolute, self._transposed = abs(self.A), sp.csr_matrix(self.A.T)

    def act(self, x: Floats) -> Floats:
        """A'x, (n,)."""
        return self._transposed @ x
