"""A fixed point found from what was tried before: mixing (Anderson 1965).

What follows from weights is taken to be affine between those tried last, and the weights are sought that would follow
from themselves. Where it is affine (sets do not change, and laws are so) a few programs end it, also where plain
iteration diverges, because weights rise steeply with slip.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats

MIXED, RANK = 6, 1e-10
"""Iterates that are mixed, and the part of their largest difference below which another is none."""


def mixed(tried: list[tuple[Floats, Floats]]) -> Floats:
    """The weights to try next, after weights (m,) and what followed from them."""
    last = tried[-MIXED:]
    followed = np.array([f for _, f in last])
    missed = followed - [w for w, _ in last]
    share = np.linalg.lstsq(np.diff(missed, axis=0).T, missed[-1], rcond=RANK)[0]
    best: Floats = np.maximum(followed[-1] - share @ np.diff(followed, axis=0), 0.0)
    return best
