"""The problems of two bodies against their closed forms."""

from __future__ import annotations

import numpy as np

import two_blocks_in_series as blocks
import vemcvx as vx


def test_two_blocks_make_one_loop(family):
    """Exact on every mesh: friction, slip and loss of the two halves of the loop."""
    mesh, times = blocks.mesh(3, family), blocks.times(20)
    history = vx.simulate(blocks.scene(), mesh, times)
    contact, (q, a) = history.contact, blocks.closed_form(times)
    assert np.abs(contact.traction[:, :, 0] - q[:, None]).max() < 1e-10
    assert np.abs(contact.slip[:, :, 0] + a[:, None]).max() < 1e-10
    # Steps of 1/4 end at the turns t = 1, 3, 5: from the first turn on it is one closed loop.
    turn = 4
    loop = 4 * blocks.BOUND * (blocks.AMPLITUDE - blocks.BOUND * blocks.COMPLIANCE)
    assert np.abs(contact.wear[-1] - contact.wear[turn] - loop).max() < 1e-10
