"""Certificates under Coulomb's law."""

import json

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx

pytestmark = pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact")


def wedge(coefficient, power=None):
    """Return a slider at u, with the pressure p = 1 + .9 u and the bound w(p) at t = 1. If it slips, u = 3.5 - w(p)."""

    def weights(t, p, past, slip):
        return coefficient * (p if power is None else p**power)

    slope = None if power is not None else lambda t, p, past: np.full((1, 1), coefficient)
    norms = vx.Norms([[1.0, 0.0]], 0.0, law=vx.Law(weights, slope=slope, slips=False))
    stiffness = [[1.0, -0.9], [-0.9, 1.0]]
    return vx.System(stiffness, lambda t: [3.5 * t, t], norms, limits=vx.Limits([[0.0, 1.0]], 0.0))


def test_newton_finds_a_solution_where_fixed_points_cycle():
    """With the coefficient 3, fixed-point iteration jumps between stick and slip."""
    run = vx.march(wedge(3.0), [0.0, 1.0])
    u = (3.5 - 3.0) / (1 + 0.9 * 3.0)
    assert run.state[-1] == pytest.approx([u, 0.0], rel=1e-12)
    assert run.pressures[-1, 0] == pytest.approx(1 + 0.9 * u, rel=1e-12)
    assert run.certificate_kind == "for the given friction"
    assert run.certificate[-1] < 1e-12


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-8])
def test_a_user_defined_law_needs_no_slope(accuracy):
    """For w = sqrt(p), u = 3.5 - sqrt(1 + .9 u) is a quadratic equation."""
    u = 3.5 + 0.45 - np.sqrt((3.5 + 0.45) ** 2 - (3.5**2 - 1))
    run = vx.march(wedge(1.0, 0.5), [0.0, 1.0], solver=vx.Newton(accuracy=accuracy))
    assert run.certificate_kind == "for the given friction"
    assert run.certificate[-1] <= accuracy
    # The factor 2 follows from dw/dp = 1 / (2 sqrt(p)) < 1/2.
    assert abs(run.state[-1, 0] - u) <= 2 * run.certified[-1] * run.norm[-1]


def resting(push=0.29, mu=0.3, young=200.0, press=1.0):
    """Return the scene of a block without supports that is pressed and pushed on a floor."""

    return vx.Scene(
        vx.Elasticity(young, 0.3),
        vx.Pressure(press, on="top"),
        vx.Traction(lambda x, t: [push * press * t, 0.0], on="left"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(mu, on="bottom"),
    )


HELD = vx.Scene(
    vx.Elasticity(200.0, 0.3),
    vx.Clamp(on="top"),
    vx.BodyForce((0.0, -4.0)),
    vx.Traction(lambda x, t: [3.0 * t, 0.0], on="left"),
    vx.UnilateralContact(on="bottom"),
    vx.CoulombFriction(0.4, on="bottom"),
)


@mostly_long("n", [3, 6, 9, 12])
def test_a_block_unloaded_to_zero_has_no_contact_forces(n):
    """A thermal strain that is linear in y causes no stress."""
    scene = vx.Scene(
        vx.Elasticity(1000.0, 0.3),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
        vx.Pressure(lambda x, t: 2.0 * (1 - t), on="top"),
        vx.ThermalStrain(1e-5, lambda x, t: 100 * t * x[:, 1]),
    )
    history = vx.simulate(scene, vx.meshes.squares(n), [0.0, 1.0], initial="settled")
    contact = history.contact
    assert contact.pressure[0] @ contact.lengths == pytest.approx(2.0, rel=1e-9)
    assert history.certificate.max() <= 1e-8
    assert contact.pressure[1].max() <= 1e-8 * 2.0
    assert np.abs(contact.traction[1]).max() <= 1e-8 * 2.0
    assert np.abs(history.forces[1]).max() <= 1e-8 * 2.0


STEEL = {"push": 0.5, "mu": 0.2, "young": 210e9, "press": 60e6}


@mostly_long(
    "given, size, solver, most",
    [
        ({}, (1.0, 1.0), vx.Newton(), 50),
        (STEEL, (0.08, 0.02), vx.Newton(), 50),
        ({}, (1.0, 1.0), vx.Clarabel(), 500),
        ({}, (1.0, 1.0), vx.OSQP(accuracy=1e-8, polish=True), np.inf),
    ],
    *(0, 1),
    ids=["Newton", "steel in SI units", "Clarabel", "OSQP, polished"],
)
def test_a_body_held_by_friction_and_contact_needs_few_iterations(given, size, solver, most):
    mesh = vx.meshes.squares((6, 6) if size[0] == size[1] else (4, 1), box=((0, size[0]), (0, size[1])))
    history = vx.simulate(resting(**given), mesh, [0.0, 0.5, 1.0], initial="settled", solver=solver)
    push, press = given.get("push", 0.29) * size[1], given.get("press", 1.0)
    assert history.iterations.max() <= most
    assert history.certificate.max() <= solver.accuracy
    wanted = press * np.column_stack([-push * history.times, np.full(3, size[0])])
    assert history.force("bottom") == pytest.approx(wanted, abs=1e-9 * press)


def test_clarabel_helps_newton_where_iterations_run_out():
    run, few = (
        vx.simulate(HELD, vx.meshes.squares(4), [0.0, 1.0], initial="settled", solver=vx.Newton(max_iterations=most))
        for most in (60, 1)
    )
    assert few.certificate[-1] <= 1e-8
    assert few.energy[-1] == pytest.approx(run.energy[-1], rel=1e-10)
    assert few.iterations[-1] > 10


@pytest.mark.long
def test_outputs_name_the_kind_of_certificate(tmp_path):
    mesh, given = vx.meshes.squares(2), vx.TrescaFriction(0.3, on="bottom")
    follows = vx.simulate(resting(), mesh, [0.0, 1.0], initial="settled")
    tresca = resting().without(vx.CoulombFriction).without(vx.UnilateralContact)
    bound = vx.simulate(tresca.with_(vx.BilateralContact(on="bottom"), given), mesh, [0.0, 1.0], initial="settled")
    for kind, history in (("bound", bound), ("for the given friction", follows)):
        assert history.certificate_kind == kind
        assert ("for the given friction" in history.summary()) == (history is follows)
        folder = tmp_path / kind.replace(" ", "_")
        history.write(folder)
        assert json.loads((folder / "summary.json").read_text())["certificate_kind"] == kind
        assert vx.read_history(folder).certificate_kind == kind
