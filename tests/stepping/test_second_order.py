"""Friction work and work of second order: beside the ledger of backward Euler, which is of first."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.effects import ContactSurface, Contribution, Friction
from vemcvx.scene import pose_scene

TIMES = np.linspace(0.0, 2.0, 25)


def pressed_and_rubbed(steps, coefficient=0.3):
    """A pad that is pressed on a rough floor while it is rubbed to and fro: bounds of friction follow pressures."""

    def plate(x, t):
        return np.tile([0.06 * np.sin(np.pi * t), -0.02 * min(t, 1.0)], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(100.0, 0.3),
        vx.PrescribedDisplacement(plate, on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(coefficient, on="bottom"),
    )
    return vx.simulate(scene, vx.meshes.squares(5, box=((0.0, 2.0), (0.0, 1.0))), np.linspace(0.0, 2.0, steps + 1))


@pytest.mark.long
def test_friction_work_and_work_are_of_second_order():
    runs = {steps: pressed_and_rubbed(steps) for steps in (24, 48, 384)}
    truth = runs[384]
    for name in ("dissipated", "work"):
        errors = {}
        for kind in (name, f"{name}_second_order"):
            best = getattr(truth, f"{name}_second_order")[-1]
            errors[kind] = [abs(getattr(runs[steps], kind)[-1] - best) / best for steps in (24, 48)]
        first, second = errors[name], errors[f"{name}_second_order"]
        # Of first order: halved at best. Of second: a quarter is left; a third allows for the steps in which a place
        # begins to slip.
        assert first[1] > 0.4 * first[0]
        assert second[1] < 0.34 * second[0]
        assert second[0] < 0.2 * first[0]
    wear = [runs[steps].contact.wear_second_order[-1] for steps in (24, 48, 384)]
    assert np.abs(wear[1] - wear[2]).max() < 0.34 * np.abs(wear[0] - wear[2]).max()


@pytest.mark.long
def test_energies_balance_and_wear_sums_to_what_is_dissipated():
    history = pressed_and_rubbed(24)
    contact = history.contact
    assert history.work_second_order == pytest.approx(
        history.energy - history.energy[0] + history.dissipated_second_order, rel=1e-14
    )
    lost = contact.wear_second_order @ contact.friction_lengths
    assert lost == pytest.approx(history.dissipated_second_order, rel=1e-12, abs=1e-15)


def test_where_bounds_are_constant_both_friction_works_are_one():
    """Whatever the slips: w |s| has no other end of the step to look at."""
    pull = vx.Traction(lambda x, t: np.tile([8.0 * np.sin(2.0 * t), -1.0 * t], (len(x), 1)), on="left")
    held = vx.Elasticity(200.0, 0.3), vx.Clamp(on="right"), vx.BilateralContact(on="bottom")
    history = vx.simulate(
        vx.Scene(*held, pull, vx.TrescaFriction(2.0, backward=1.0, on="bottom")), vx.meshes.squares(6), TIMES
    )
    assert history.dissipated[-1] > 0
    assert history.dissipated_second_order == pytest.approx(history.dissipated, rel=1e-9)


@pytest.mark.long
def test_supports_that_drag_nodes_and_weights_that_never_give_way_count_alike():
    """Friction against what supports drag has the bounds of both ends, too; sticking costs nothing under any bound."""
    drag = vx.PrescribedDisplacement(lambda x, t: np.tile([0.1 * t, 0.0], (len(x), 1)), on="bottom")
    bound = vx.TrescaFriction(lambda x, t: 1.0 + t * np.ones(len(x)), on="bottom")
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.BilateralContact(on="bottom"), bound, drag)
    history = vx.simulate(scene, vx.meshes.squares(4), np.linspace(0.0, 1.0, 5))
    # int g(t) |u'(t)| dt over the length 1 of the bottom: .1 int (1 + t) dt = .15, and the bound is linear in time.
    assert history.dissipated_second_order[-1] == pytest.approx(0.15, rel=1e-12)
    assert history.dissipated[-1] == pytest.approx(0.1 * (1.0 + np.arange(1, 5) / 4).mean(), rel=1e-12)
    stuck = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: np.tile([5.0 * t, -t], (len(x), 1)), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(1e20, on="bottom"),
    )
    assert vx.simulate(stuck, vx.meshes.voronoi(5), TIMES).dissipated_second_order.max() < 1e-12


@pytest.mark.long
def test_viscous_losses_count_in_both():
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Viscosity(shear=20.0, volume=40.0),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: np.tile([5.0 * t, -t], (len(x), 1)), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(1.0, on="bottom"),
    )
    history = vx.simulate(scene, vx.meshes.squares(4), TIMES)
    assert history.dissipated_second_order == pytest.approx(history.dissipated, rel=1e-9)


@dataclass(frozen=True)
class Polished(vx.Effect):
    """Friction whose bound decays with the slip before the step, as in .ci/site/howto/own_law.md."""

    distance: float

    def contribute(self, space):
        rows = space.part("bottom", "Polished", contact=True).node_normals
        law = vx.Law(lambda t, p, past, slip: rows.lengths * np.exp(-past / self.distance), softening=0.0)
        friction = replace(Friction.of(rows, "Polished"), law=law)
        return Contribution(frictions=(friction,), surfaces=(ContactSurface.of(rows),))

    def describe(self):
        return "Polished"


@pytest.mark.parametrize("viscous", [False, True])
def test_friction_that_reads_the_slip_before_the_step_is_of_second_order(viscous):
    """A block that slides as a whole by a given way a: it loses int exp(-A / d) dA = d (1 - exp(-a / d)) a length.

    The bound that acts is that before the step; both its ends are those of the slips before and after it.
    """
    d, way = 0.3, 0.2
    move = vx.PrescribedDisplacement(lambda x, t: np.tile([way * t, 0.0], (len(x), 1)), on="top")
    level = vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(0.0, 1.0))
    # So stiff that it slips all the way but for 1e-6 of it.
    steel = (vx.Elasticity(1e6, 0.3), *([vx.Viscosity(1e-3, 1e-3)] if viscous else []))
    scene = vx.Scene(*steel, move, level, vx.BilateralContact(on="bottom"), Polished(d))
    truth, errors = d * (1 - np.exp(-way / d)), []
    for steps in (8, 16):
        history = vx.simulate(scene, vx.meshes.squares(2), np.linspace(0.0, 1.0, steps + 1))
        errors.append(abs(history.dissipated_second_order[-1] - truth))
        assert abs(history.dissipated[-1] - truth) > 10 * errors[-1]
    # The trapezoidal rule: a / 12 (a / steps)^2 max |g''|.
    assert errors[0] < way**3 / (12 * d**2 * 8**2) + 1e-5
    assert errors[1] < way**3 / (12 * d**2 * 16**2) + 1e-5


def rub(x, t):
    return np.tile([0.06 * np.sin(5 * t), -0.02 * np.sin(2 * t)], (len(x), 1))


def rising(x, t):
    return np.full(len(x), 1.0 + t)


@pytest.mark.parametrize("backward", [None, 0.3])
def test_loss_has_the_mean_of_the_bounds_of_both_ends(backward):
    friction = vx.TrescaFriction(rising, on="bottom", backward=backward)
    top = vx.PrescribedDisplacement(rub, on="top")
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.BilateralContact(on="bottom"), friction, top)
    mesh = vx.meshes.squares(3)
    times = np.linspace(0.0, 1.0, 7) ** 1.2
    run = vx.simulate(scene, mesh, times, solver=vx.Newton()).trajectory
    system = pose_scene(scene, mesh).system
    given = np.array([system.prescribed_slip(t) for t in times])
    slip = np.diff(run.state @ system.B.T.toarray() + given, axis=0)
    bias, w = np.array([system.bias(t) for t in times]), run.weights
    loss = 0.5 * (w[1:] + w[:-1]) * np.abs(slip) + 0.5 * (bias[1:] + bias[:-1]) * slip
    # Sums of 7 products, each to a few roundings.
    assert np.abs(np.diff(run.worn_second_order, axis=0) - loss).max() < 1e-12 * loss.sum()
    assert run.dissipated_second_order[-1] < 0.98 * run.dissipated[-1]  # the bound has grown
