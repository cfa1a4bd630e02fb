"""Problems with laws of slip rates or with dashpots, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import brake_pad as brake
import damped_support as support
import gallery
import vemcvx as vx


def test_friction_that_grows_with_speed_creeps_to_its_steady_value():
    errors = []
    for steps in (40, 80):
        run = vx.simulate(brake.scene(), brake.mesh(3), brake.times(steps), initial="settled")
        found = brake.measure_friction(run)
        errors.append(np.abs(found - brake.friction(run.times)).max())
        # In a step k of backward Euler, the distance to the steady value decreases by the factor 1 / (1 + k / tau).
        left, tau = brake.bound(brake.SPEED) - found[steps // 5 :], brake.GROWTH * brake.HEIGHT / brake.G
        assert left[1:] == pytest.approx(left[:-1] / (1 + 0.4 / steps / tau), abs=1e-10)
        assert run.certificate_kind == "bound"
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.1)


def test_friction_that_falls_with_speed_is_a_sawtooth_with_a_certificate_for_the_given_friction():
    with pytest.warns(vx.SceneWarning, match="the ratio of softening to stiffness is 3;.*longer steps"):
        run = vx.simulate(brake.scene(-0.15), brake.mesh(3), brake.times(80), initial="settled")
    assert run.certificate_kind == "for the given friction"
    found, (low, high, period) = brake.measure_friction(run), brake.evaluate_saw()
    assert found.max() == pytest.approx(high)
    assert found[found.argmax() :].min() == pytest.approx(low)
    falls = run.times[1:][np.diff(found) < 0]
    # The pad slips one step (.005) after its friction reaches the bound.
    assert np.diff(falls) == pytest.approx(period + 0.005)


def test_a_block_sinks_into_its_dashpots_like_an_exponential():
    """The errors of depth and loss are O(k) for steps of size k."""
    errors, mesh = [], support.mesh(3)
    mesh = mesh.with_cell_data("all", np.ones(mesh.n_cells))
    for steps in (50, 100):
        run = vx.simulate(support.scene(), mesh, support.times(steps))
        found, loaded = support.measure_sinking(run), run.times <= support.REST
        assert found[loaded] == pytest.approx(support.sinking_of_steps(run.times[loaded]), abs=1e-13)
        assert found[~loaded] == pytest.approx(0.0, abs=1e-13)
        # The block begins at zero, although the weight acts from the first instant on.
        assert run.energy[0] == np.abs(run.displacement[0]).max() == 0.0
        end, weight = np.flatnonzero(loaded)[-1], support.WEIGHT * support.HEIGHT * support.LENGTH
        work = -weight * run.mean("displacement", on="all")[end, 1]
        assert run.work[end] == pytest.approx(work, rel=1e-9)
        lost = run.dissipated[end] - support.evaluate_loss(support.REST)
        errors.append([np.abs(found - support.sinking(run.times)).max(), abs(lost)])
        assert run.certificate_kind == "bound"
    assert np.log2(np.divide(*errors)) == pytest.approx(1.0, abs=0.1)


def test_a_block_without_springs_creeps_at_a_constant_speed():
    with gallery.quiet():
        run = vx.simulate(support.scene(spring=0.0), support.mesh(3), np.linspace(0.0, support.REST, 6))
    assert support.measure_sinking(run) == pytest.approx(support.sinking(run.times, 0.0), rel=1e-12)
    assert run.contact.pressure[1:] == pytest.approx(support.WEIGHT * support.HEIGHT)
