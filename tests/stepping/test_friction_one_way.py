"""Friction that holds one way more than the other: w+ s+ + w- s-, half a sum of bounds and half a difference."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scenes import paper_scene

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

FORTH, BACK = 2.0, 0.5
TIMES = np.linspace(0.0, 4.0, 33)


def load(t):
    return 3.0 * np.sin(1.7 * t) - 0.2 * t


def play():
    """A spring of one that drags a slider: it stays until the force exceeds the bound of its direction."""
    y = np.zeros(len(TIMES))
    for n in range(1, len(TIMES)):
        y[n] = np.clip(y[n - 1], load(TIMES[n]) - FORTH, load(TIMES[n]) + BACK)
    return y


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel(), vx.OSQP()], ids=lambda s: s.name)
@pytest.mark.parametrize("condense", [True, False])
def test_one_slider_in_closed_form(solver, condense):
    mean, tilt = 0.5 * (FORTH + BACK), 0.5 * (FORTH - BACK)
    system = vx.System([[1.0]], lambda t: [load(t)], vx.Norms([[1.0]], mean, bias=lambda t: [tilt]))
    run = vx.march(system, TIMES, solver=solver, condense=condense)
    y, step = play(), np.diff(play())
    loose = 10 * solver.accuracy * np.abs(y).max()
    assert np.abs(run.state[:, 0] - y).max() <= loose
    # The multiplier is the whole friction: K y = load - lam, between -w- and w+.
    assert np.abs(run.multipliers[:, 0, 0] - (load(TIMES) - y)).max() <= loose
    lost = np.append(0.0, np.cumsum(np.where(step > 0, FORTH, BACK) * np.abs(step)))
    assert np.abs(run.dissipated - lost).max() <= 30 * loose
    rest = run.work - (run.energy - run.energy[0]) - run.dissipated
    assert np.abs(rest[1:] - np.cumsum(0.5 * step**2)).max() <= 30 * loose


def test_equal_bounds_are_plain_friction(family):
    mesh = vx.meshes.FAMILIES[family](4)
    plain, equal = (
        vx.simulate(paper_scene().without(vx.TrescaFriction).with_(friction), mesh, np.linspace(0, 1, 9))
        for friction in (vx.TrescaFriction(4.0, on="bottom"), vx.TrescaFriction(4.0, on="bottom", backward=4.0))
    )
    assert np.array_equal(plain.displacement, equal.displacement)
    assert np.array_equal(plain.contact.wear, equal.contact.wear)


def block(sign, forth, back):
    """Pulled to and fro along the floor, mirrored by the sign."""

    def pull(x, t):
        return np.tile([sign * 6.0 * np.sin(2 * np.pi * t), -0.5], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.ElasticFoundation(tangential=20.0, on="top"),
        vx.Traction(pull, on=["left", "right"]),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(forth, on="bottom", backward=back),
    )


@pytest.mark.long
def test_a_mirrored_block_slides_the_other_way():
    """Squares are their own mirror image; forward becomes backward, bound and wear go along."""
    n, times = 8, np.linspace(0, 1, 17)
    right = vx.simulate(block(1.0, 3.0, 1.0), vx.meshes.squares(n), times, initial="settled")
    left = vx.simulate(block(-1.0, 1.0, 3.0), vx.meshes.squares(n), times, initial="settled")
    # Row by row from left to right: the mirror reverses each row.
    mirrored = left.displacement.reshape(17, n + 1, n + 1, 2)[:, :, ::-1] * [-1.0, 1.0]
    scale = np.abs(right.displacement).max()
    assert np.abs(right.displacement - mirrored.reshape(right.displacement.shape)).max() <= 1e-8 * scale
    mine, other = right.contact, left.contact
    assert np.abs(mine.wear - other.wear[:, ::-1]).max() <= 1e-7 * mine.wear.max()
    assert np.abs(mine.bound - other.backward[:, ::-1]).max() <= 1e-12
    assert np.abs(mine.bound - 3.0).max() <= 1e-12
    assert np.abs(mine.backward - 1.0).max() <= 1e-12
    assert right.contact.wear[-1].max() > 0
    plain = vx.simulate(block(1.0, 3.0, 3.0), vx.meshes.squares(n), times, initial="settled")
    assert np.abs(plain.displacement - right.displacement).max() > 1e-2 * scale


def test_traction_keeps_to_the_bound_of_its_direction():
    history = vx.simulate(block(1.0, 3.0, 1.0), vx.meshes.squares(8), np.linspace(0, 1, 17), initial="settled")
    traction = history.contact.traction[:, :, 0]
    # Forward, to the right on the floor: friction on the body points to the left.
    assert traction.min() == pytest.approx(-3.0, rel=1e-6)
    assert traction.max() == pytest.approx(1.0, rel=1e-6)
    assert (traction >= -history.contact.bound * (1 + 1e-6)).all()
    assert (traction <= history.contact.backward * (1 + 1e-6)).all()


@pytest.mark.long
@pytest.mark.parametrize("viscous", [False, True])
def test_the_ledger_closes(viscous):
    """With a support that drags the block along: work = stored + dissipated + 1/2 a(du, du), step by step."""
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(
            lambda x, t: np.tile([0.05 * np.sin(2 * np.pi * t), 0.0], (len(x), 1)), on=["right", "bottom side"]
        ),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(3.0, on="bottom", backward=1.0),
        *([vx.Viscosity(shear=5.0)] if viscous else []),
    )
    mesh = vx.meshes.voronoi(5).with_boundary("bottom side", lambda p: (p[:, 1] < 1e-9) & (p[:, 0] > 0.8))
    history = vx.simulate(scene, mesh, np.linspace(0, 1, 17))
    rest = history.work - (history.energy - history.energy[0]) - history.dissipated
    assert (np.diff(rest) >= -1e-12 * history.work.max()).all()
    contact = history.contact
    rubbed = np.einsum("sm,m->s", contact.wear, contact.friction_lengths)
    if not viscous:
        assert rubbed == pytest.approx(history.dissipated, abs=1e-14)
        K = vx.simulate(scene, mesh, [0.0, 1.0]).trajectory
        assert K.norm[-1] >= 0


def test_mistakes():
    with pytest.raises(
        vx.SceneError, match=r"TrescaFriction on bottom: found the backward bound -1 at .* must be >= 0"
    ):
        vx.simulate(block(1.0, 3.0, -1.0), vx.meshes.squares(2), [0.0, 1.0], initial="settled")
    for bias, says in (
        (lambda t: [2.0], "found a bias larger than the weight of norm term 0"),
        (lambda t: [0.1, 0.2], r"Norms: bias: found an array of shape \(2,\); wanted \(1,\) forces"),
        (lambda t: [np.nan], "Norms: bias: found NaN"),
    ):
        system = vx.System([[1.0]], lambda t: [t], vx.Norms([[1.0]], 1.0, bias=bias))
        with pytest.raises(vx.SceneError, match=says):
            vx.march(system, [0.0, 1.0])


@cache
def held_by(bound):
    """Friction of so much, and of twice as much backwards, against a load of one."""
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: np.column_stack([np.full(len(x), t), np.zeros(len(x))]), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, backward=2 * bound, on="bottom"),
    )
    return vx.simulate(scene, vx.meshes.squares(6), [0.0, 0.5, 1.0])


def test_bounds_far_above_every_force_leave_energies_their_digits():
    """Nothing slips: bounds of 1e8 and 2e8 are as good as 1 and 2, but for the digits that the certificate says."""
    near, far = held_by(1e2), held_by(1e8)
    assert near.contact.sticking.all()
    left = far.certificate + far.certificate_floor
    assert 1e-12 < left.max() < 1e-6
    # An error e of u is one of (2 + e) e of its energy; work is twice the energy where nothing is lost.
    for one, other in ((near.energy, far.energy), (near.work, far.work)):
        assert (np.abs(one - other) <= 3 * left * one.max()).all()
    assert near.energy[-1] > 1e-4


def test_bounds_far_above_every_force_are_no_measure_of_accuracy():
    """What friction could exert, 1e8, is not what the load of 1 can cause: errors are relative to the state."""
    run = held_by(1e8).trajectory
    assert np.array_equal(run.unit[1:], run.norm[1:])


@pytest.mark.parametrize("condense", [True, False])
def test_a_slider_gives_way_where_only_the_difference_of_its_bounds_changes(condense):
    """Load and weight stay; the bound of the way it is pulled falls from 2 to 1/4, that of the other rises."""
    norms = vx.Norms([[1.0]], 2.0, bias=lambda t: [1.75 * max(t - 1.0, 0.0)])
    run = vx.march(vx.System([[1.0]], lambda t: [-min(t, 1.0)], norms), [0.0, 1.0, 2.0], condense=condense)
    assert run.state[:, 0] == pytest.approx([0.0, 0.0, -0.75], abs=1e-12)
