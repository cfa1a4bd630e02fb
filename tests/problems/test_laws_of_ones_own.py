"""Problems with a user's law of friction or glue, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import cohesive_interface as glued
import slip_weakening as weakening
import vemcvx as vx


@pytest.mark.long
def test_slip_weakening_follows_its_closed_form(family):
    mesh, times = weakening.mesh(3, family), weakening.times(20)
    history = vx.simulate(weakening.scene(), mesh, times, solver=vx.Newton(1e-11))
    assert history.certificate_kind == "for the given friction"
    contact, (q, a) = history.contact, weakening.exact_solution(times)
    path = np.append(0.0, np.abs(np.diff(a)).cumsum())
    # The bound also falls while the block slips back.
    bound = np.maximum(weakening.PEAK - weakening.FALL * path, weakening.RESIDUAL)
    assert (np.diff(bound[times > 1.5]) < 0).any()
    for found, exact in (
        (contact.slip[:, :, 0], a),
        (-contact.traction[:, :, 0], q),
        (contact.accumulated_slip, path),
        (contact.bound, bound),
    ):
        assert np.abs(found - exact[:, None]).max() < 1e-10 * np.abs(exact).max()


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Newton(1e-11), vx.Clarabel(1e-6)], ids=["Newton", "Clarabel"])
def test_glue_that_softens_follows_its_closed_form(solver):
    mesh, times = glued.mesh(2, "hexagons"), glued.times(24)
    history = vx.simulate(glued.scene(), mesh, times, solver=solver)
    assert history.certificate_kind == "for the given friction"
    contact, (sigma, a) = history.contact, glued.exact_solution(times)
    apart = history.displacement[:, contact.partners, 1] - history.displacement[:, contact.nodes, 1]
    assert np.abs(apart - a[:, None]).max() < 1e-10 * a.max()
    assert np.abs(contact.pressure + sigma[:, None]).max() < 1e-10 * sigma.max()
    assert np.abs(contact.traction).max() < 1e-10 * sigma.max()
    assert sigma[np.searchsorted(times, 1.75)] < 0 < sigma.max()
    assert sigma[-1] == 0 < a[-1]
