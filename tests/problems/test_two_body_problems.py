"""The problems of two bodies against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import press_fit as fit
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


def fitted(n, outer=None):
    """Contact pressures over Lame's, and the lengths of their nodes."""
    mesh = fit.mesh(n, outer=outer)
    history = vx.simulate(fit.scene(), mesh, [0.0, 1.0], solver=vx.Newton(fit.SMALL["accuracy"]))
    contact = history.contact
    assert contact.closed[-1].all()
    return contact.pressure[-1] / fit.pressure(), contact.lengths


def test_a_press_fit_on_equal_meshes():
    """Every nodal pressure within one per cent of Lame's, uniform, and of order h^2."""
    coarse, fine = (fitted(n, outer=n)[0] for n in (8, 16))
    assert np.abs(coarse - 1).max() < 0.01
    # All sectors are alike, and the pressure of one solve is certified to 1e-7 in energy.
    assert np.ptp(coarse) < 1e-6
    assert 3.5 < np.abs(coarse - 1).max() / np.abs(fine - 1).max() < 4.5


def errors_of_press_fit(n):
    """Of the mean pressure, and of nodal pressures in L2, relative."""
    ratio, lengths = fitted(n)
    shares = lengths / lengths.sum()
    return abs(shares @ ratio - 1), np.sqrt(shares @ (ratio - 1) ** 2)


def test_a_press_fit_on_meshes_that_do_not_match():
    mean, nodal = errors_of_press_fit(8)
    # The angle between chord and arc is pi/4n at most, and its square is what the mean may lose.
    assert nodal < np.pi / (4 * 8)
    assert mean < (np.pi / (4 * 8)) ** 2


@pytest.mark.slow
def test_nodal_pressures_of_a_press_fit_are_of_order_one():
    """The chords of one polygon on another: order h in nodal pressures, h^2 in their mean; .9 % and .03 % at n = 32."""
    mean, nodal = np.transpose([errors_of_press_fit(n) for n in (8, 16, 32)])
    assert (np.abs(np.log2(nodal[:-1] / nodal[1:]) - 1) < 0.2).all()
    assert (np.abs(np.log2(mean[:-1] / mean[1:]) - 2) < 0.2).all()
    assert nodal[-1] < 0.01


def test_rings_that_are_pressed_together_are_stressed_as_lame_says():
    """The first invariant at centroids, by the square of the angle of a cell."""
    history = vx.simulate(fit.scene(), fit.mesh(16, outer=16), [0.0, 1.0], solver=vx.Newton(fit.SMALL["accuracy"]))
    x, (xx, yy, _) = history.mesh.centroids, history.stress(-1).T
    radial, hoop = fit.stresses(np.hypot(*x.T))
    # The trace does not depend on the angle of the axes.
    assert xx + yy == pytest.approx(radial + hoop, abs=(np.pi / 32) ** 2 * np.abs(radial + hoop).max())
