"""The frictional hysteresis patch test: a closed form with stick, slip and reversal, exact on every mesh."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import any_family

import frictional_hysteresis as patch
import vemcvx as vx

pytestmark = pytest.mark.arithmetic


@any_family
def test_displacements_dissipation_and_tractions_are_exact(family):
    times = patch.times(20)
    history, (gamma, a) = vx.simulate(patch.scene(), patch.mesh(4, family), times), patch.exact_solution(times)
    exact = patch.exact(history.mesh.points, times)
    assert np.abs(history.displacement - exact).max() < 1e-10 * patch.AMPLITUDE
    loss = np.append(0.0, patch.BOUND * patch.LENGTH * np.cumsum(np.abs(np.diff(a))))
    assert np.abs(history.dissipated - loss).max() < 1e-10 * loss[-1]
    # The loop from t = 1 to t = 5 is closed.
    slip = patch.AMPLITUDE - patch.BOUND * patch.HEIGHT / patch.MU
    assert loss[20] - loss[4] == pytest.approx(4 * patch.BOUND * patch.LENGTH * slip, rel=1e-10)
    slips = np.append(False, np.abs(np.diff(a)) > 1e-12 * patch.AMPLITUDE)
    assert 0 < slips.sum() < 20
    assert (history.contact.sticking == ~slips[:, None]).all()
    # The outward normal of the bottom is (0, -1): friction on the body is minus the shear stress.
    assert np.abs(history.contact.traction[:, :, 0] + patch.MU * gamma[:, None]).max() < 1e-10 * patch.BOUND
    assert np.abs(history.contact.pressure).max() < 1e-10 * patch.BOUND
