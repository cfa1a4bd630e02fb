"""Problems with a user's law of friction or of glue, against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import cohesive_interface as glued
import slip_weakening as weakening
import vemcvx as vx
from vemcvx.scene import pose_scene


def bound_errors(history, scene, rho, turns=3):
    """Return error bounds of nodal slips and of nodal forces per length, which follow from the certificates.

    With rho = softening / stiffness, each reversal multiplies errors of slips by at most (1 + rho) / (1 - rho).
    """
    run = history.trajectory
    total = ((1 + rho) / (1 - rho)) ** turns * (np.sqrt(2 * run.gap) + np.sqrt(2 * run.floor)).sum()
    system = pose_scene(scene, history.mesh).system
    felt = system.B @ np.linalg.solve(system.K.toarray(), system.B.T.toarray())
    stiff = np.sqrt(np.diag(np.linalg.inv(felt)).max())
    return np.sqrt(np.diag(felt).max()) * total, 2 * stiff * total / history.contact.lengths.min()


@pytest.mark.long
def test_slip_weakening_follows_its_closed_form(family):
    mesh, times = weakening.mesh(3, family), weakening.times(20)
    history = vx.simulate(weakening.scene(), mesh, times, solver=vx.Newton(1e-9))
    assert history.certificate_kind == "for the given friction"
    q, a = weakening.exact_solution(times)
    slip, force = bound_errors(history, weakening.scene(), rho=0.5)
    assert slip < 1e-3 * np.abs(a).max()
    assert np.abs(history.contact.slip[:, :, 0] - a[:, None]).max() < slip
    assert np.abs(-history.contact.traction[:, :, 0] - q[:, None]).max() < force
    path = np.append(0.0, np.abs(np.diff(a)).cumsum())
    assert np.abs(history.contact.accumulated_slip - path[:, None]).max() < slip
    # Friction weakens in both directions.
    bound = np.maximum(weakening.PEAK - weakening.FALL * path, weakening.RESIDUAL)
    assert np.abs(history.contact.bound - bound[:, None]).max() < weakening.FALL * slip + 1e-12
    assert (np.diff(bound[times > 1.5]) < 0).any()


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Newton(1e-8), vx.Clarabel(1e-6)], ids=["Newton", "Clarabel"])
def test_glue_that_softens_follows_its_closed_form(solver):
    mesh, times = glued.mesh(2, "hexagons"), glued.times(24)
    history = vx.simulate(glued.scene(), mesh, times, solver=solver)
    assert history.certificate_kind == "for the given friction"
    contact, (sigma, a) = history.contact, glued.exact_solution(times)
    apart = history.displacement[:, contact.partners, 1] - history.displacement[:, contact.nodes, 1]
    gap, force = bound_errors(history, glued.scene(), glued.COMPLIANCE * glued.STRENGTH / glued.WAY)
    assert gap < 1e-2 * a.max()
    assert np.abs(apart - a[:, None]).max() < gap
    assert np.abs(contact.pressure + sigma[:, None]).max() < force
    assert np.abs(contact.traction).max() < force
    assert sigma[np.searchsorted(times, 1.75)] < 0 < sigma.max()
    assert sigma[-1] == 0 < a[-1]
