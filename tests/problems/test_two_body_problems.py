"""The problems of two bodies against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import bolted_joint as joint
import brake_pad_on_disc as brake
import hertz_two_cylinders as cylinders
import lap_joint as lap
import pack_of_blocks as pack
import press_fit as fit
import two_blocks_in_series as blocks
import vemcvx as vx
from hertz_contact import fit_half_ellipse

FEW_SETS = 20
"""Largest number of linear systems in a step that starts from the active sets of the previous step."""


@pytest.mark.long
def test_two_blocks_make_one_loop(family):
    """Friction, slip and loss of the closed loop are exact on every mesh."""
    mesh, times = blocks.mesh(3, family), blocks.times(20)
    history = vx.simulate(blocks.scene(), mesh, times)
    contact, (q, a) = history.contact, blocks.exact_solution(times)
    assert np.abs(contact.traction[:, :, 0] - q[:, None]).max() < 1e-10
    assert np.abs(contact.slip[:, :, 0] + a[:, None]).max() < 1e-10
    # Steps of 1/4 end at the turns t = 1, 3, 5. The steps after the first turn make one closed loop.
    turn = 4
    loop = 4 * blocks.BOUND * (blocks.AMPLITUDE - blocks.BOUND * blocks.COMPLIANCE)
    assert np.abs(contact.wear[-1] - contact.wear[turn] - loop).max() < 1e-10


@pytest.mark.long
def test_a_pack_of_blocks_slides_one_by_one(family):
    """Tractions, slips and the plate force (Masing's rule) are exact on every mesh."""
    mesh, times = pack.mesh(2, family), pack.times(40)
    history = vx.simulate(pack.scene(), mesh, times)
    contact, (q, a), one = history.contact, pack.exact_solution(times), pack.bearing(history.contact.points)
    assert np.abs(contact.traction[:, :, 0] - q[:, one]).max() < 1e-10
    assert np.abs(contact.slip[:, :, 0] + a[:, one]).max() < 1e-10
    assert np.abs(pack.plate_force(history) - pack.force(times)).max() < 1e-10
    # No block begins to slide exactly at an instant, so rounding does not matter.
    first = times <= 1
    assert np.array_equal(contact.sticking[first], pack.plate(times[first])[:, None] < pack.STARTS[one])
    loop = 4 * pack.BOUNDS * np.maximum(pack.AMPLITUDE - pack.STARTS, 0.0)
    turn = 8
    assert np.abs(contact.wear[-1] - contact.wear[turn] - loop[one]).max() < 1e-10
    assert history.dissipated[-1] - history.dissipated[turn] == pytest.approx(pack.LENGTH * loop.sum(), abs=1e-10)


def pressures(n, outer=None):
    """Return nodal contact pressures relative to Lame's pressure, and the tributary lengths of the nodes."""
    mesh = fit.mesh(n, outer=outer)
    history = vx.simulate(fit.scene(), mesh, [0.0, 1.0], solver=vx.Newton(fit.SMALL["accuracy"]))
    contact = history.contact
    assert contact.closed[-1].all()
    return contact.pressure[-1] / fit.pressure(), contact.lengths


@pytest.mark.long
def test_a_press_fit_on_equal_meshes():
    """Nodal pressures are uniform. The error is below one per cent of Lame's pressure, and O(h^2)."""
    coarse, fine = (pressures(n, outer=n)[0] for n in (8, 16))
    assert np.abs(coarse - 1).max() < 0.01
    # All sectors are alike, so pressures differ only because the solver stops at a certified error of 1e-7.
    assert np.ptp(coarse) < 1e-6
    assert 3.5 < np.abs(coarse - 1).max() / np.abs(fine - 1).max() < 4.5


@pytest.mark.parametrize("n", [8, pytest.param(32, marks=pytest.mark.slow)])
def test_a_press_fit_on_meshes_that_do_not_match(n):
    """Chord and arc meet at an angle e. Errors of pressures are below e, the error of the mean is below e^2."""
    ratio, lengths = pressures(n)
    weights, angle = lengths / lengths.sum(), np.pi / (4 * n)
    assert np.sqrt(weights @ (ratio - 1) ** 2) < angle
    assert abs(weights @ ratio - 1) < angle**2


@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact holds")
@pytest.mark.parametrize("cycles", [3, pytest.param(100, marks=pytest.mark.slow)])
def test_a_bolted_joint_wears_equally_in_every_cycle(cycles):
    """The joint never slips as a whole, and the middle under the bolt does not wear."""
    history = vx.simulate(joint.scene(), joint.mesh(10), joint.times(4 * cycles), initial=joint.initial)
    assert history.certificate.max() < 1e-8
    # Each step begins with the active sets of the previous step, and needs few linear systems.
    assert history.iterations[1:].max() <= FEW_SETS
    assert history.contact.sticking.any(axis=1).all()
    added = np.diff(history.contact.wear[::4], axis=0)[1:]
    added /= added.max()
    # Wear is a sum of small slips, so the tolerance is a hundred times the certified error 1e-8.
    assert np.abs(added - added[0]).max() < 1e-6
    x = history.contact.points[:, 0] - joint.LENGTH / 2
    assert added[0][np.abs(x) < joint.BOLT / 4].max() < 0.01
    assert np.abs(np.abs(x[added[0].argmax()]) - joint.BOLT / 2) < 0.1 * joint.BOLT


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact holds")
def test_a_pad_brakes_a_disc():
    """Forces balance, a slipping pad has the torque `slip_torque`, and the last two cycles have equal wear."""
    history = vx.simulate(brake.scene(), brake.mesh(4), brake.times(3 * brake.CYCLE), initial=brake.initial)
    assert history.certificate.max() < 1e-8
    assert history.iterations[1:].max() <= FEW_SETS
    contact, torque, P = history.contact, brake.torque(history), brake.pad_pressure(history.times)
    # Forces are certified to a few digits fewer than energies.
    near = {"abs": 1e-7 * brake.slip_torque(brake.PRESSURE)}
    rubbed, pushed = contact.traction * contact.friction_lengths[:, None], contact.pressure * contact.lengths
    fx, fy = np.moveaxis(rubbed - pushed[:, :, None] * contact.normals, 2, 0)
    x, y = contact.points.T
    assert (x * fy - y * fx).sum(axis=1) == pytest.approx(torque, **near)
    assert -fy.sum(axis=1) == pytest.approx(2 * brake.RIM * np.sin(brake.ALPHA) * P, **near)
    slips = ~contact.sticking.any(axis=1)
    assert slips.sum() > history.steps / 2
    # The closed form has the pressure of a worn pad. Here the pad is elastic, and torques differ by up to 1.1 per cent.
    assert np.abs(torque[slips]) == pytest.approx(brake.slip_torque(P[slips]), rel=0.02)
    assert (np.diff(history.dissipated) >= 0).all()
    assert (np.diff(contact.wear, axis=0) >= 0).all()
    added = np.diff(contact.wear[:: brake.CYCLE], axis=0)
    assert added[2] == pytest.approx(added[1], abs=1e-6 * added.max())
    assert (added[1] > 0).all()


@pytest.mark.long
def test_two_cylinders_have_the_pressure_of_hertz():
    """The half-width of the contact and the peak pressure agree with Hertz within two per cent."""
    history = vx.simulate(cylinders.scene(), cylinders.mesh(16), cylinders.times(1))
    contact, force = history.contact, cylinders.force(history)[-1]
    x, p = contact.points[:, 0], contact.pressure[-1]
    half_width, peak = cylinders.hertz(force)
    assert fit_half_ellipse(x, p) == pytest.approx((half_width, peak), rel=0.02)
    assert p.max() == pytest.approx(peak, rel=0.02)
    # The error of the half-width is less than a cell of the coarser mesh.
    assert x[p > 0].max() == pytest.approx(half_width, abs=cylinders.HALF_WIDTH / 12)


@pytest.mark.long
def test_the_glue_of_a_lap_joint_bears_its_load_at_the_ends():
    """Away from the ends, nodal tractions are within one per cent of the theory."""
    history = vx.simulate(lap.scene(), lap.mesh(4), lap.times(1))
    x, q = lap.bond(history)
    inner = (x > lap.HEIGHT) & (x < lap.LENGTH - lap.HEIGHT)
    assert q[inner] == pytest.approx(lap.shear(x[inner]), rel=0.01)
    contact = history.contact
    assert contact.sticking.all()
    # Both faces of the glue bear the force of the strips.
    below = np.abs(contact.points[:, 1] - lap.HEIGHT) < 1e-9
    forces = contact.traction[-1][:, 0] * contact.friction_lengths
    assert np.abs([forces[below].sum(), forces[~below].sum()]) == pytest.approx(lap.FORCE, rel=1e-9)
