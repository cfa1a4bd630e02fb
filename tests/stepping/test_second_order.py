"""Work and friction work are accurate to second order in the step length."""

import numpy as np
import pytest
from own_law import Law
from scenes import mostly_long

import vemcvx as vx


def pressed_and_rubbed(steps, coefficient=0.3):
    """Simulate a pad that is pressed on a rough floor and rubbed to and fro."""

    scene = vx.Scene(
        vx.Elasticity(100.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: [0.06 * np.sin(np.pi * t), -0.02 * min(t, 1.0)], on="top"),
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
        # With half the step, first-order errors are halved, and second-order errors are quartered. The limit .34 allows
        # for steps in which nodes begin to slip.
        assert first[1] > 0.4 * first[0]
        assert second[1] < 0.34 * second[0]
        assert second[0] < 0.2 * first[0]
    balance = truth.energy - truth.energy[0] + truth.dissipated_second_order
    assert truth.work_second_order == pytest.approx(balance, rel=1e-14)
    worn = truth.contact.wear_second_order @ truth.contact.friction_lengths
    assert worn == pytest.approx(truth.dissipated_second_order, rel=1e-12, abs=1e-15)
    wear = [runs[steps].contact.wear_second_order[-1] for steps in (24, 48, 384)]
    assert np.abs(wear[1] - wear[2]).max() < 0.34 * np.abs(wear[0] - wear[2]).max()


@mostly_long("viscous", [False, True])
def test_friction_work_under_a_law_of_earlier_slip_is_of_second_order(viscous):
    """A slip from 0 to x dissipates int exp(-A / d) dA = d (1 - exp(-x / d)) per unit of length."""
    d, way = 0.3, 0.2
    wears = Law(lambda t, p, past, slip: np.exp(-past / d), softening=0.0)
    move = vx.PrescribedDisplacement(lambda x, t: [way * t, 0.0], on="top")
    level = vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(0.0, 1.0))
    # The block is stiff: slip and displacement agree to 1e-6.
    steel = (vx.Elasticity(1e6, 0.3), *([vx.Viscosity(1e-3, 1e-3)] if viscous else []))
    scene = vx.Scene(*steel, move, level, vx.BilateralContact(on="bottom"), wears)
    truth, errors = d * (1 - np.exp(-way / d)), []
    for steps in (8, 16):
        history = vx.simulate(scene, vx.meshes.squares(2), np.linspace(0.0, 1.0, steps + 1))
        errors.append(abs(history.dissipated_second_order[-1] - truth))
        assert abs(history.dissipated[-1] - truth) > 10 * errors[-1]
    # For the integrand g(A) = exp(-A / d), the error of the trapezoidal rule is at most x / 12 (x / steps)^2 max |g''|.
    assert errors[0] < way**3 / (12 * d**2 * 8**2) + 1e-5
    assert errors[1] < way**3 / (12 * d**2 * 16**2) + 1e-5
