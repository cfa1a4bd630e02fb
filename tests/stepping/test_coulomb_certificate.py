"""Coulomb's certificate: that of the program whose friction bounds are those of the answer's own pressure."""

import json

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx

pytestmark = pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact")


def wedge(coefficient, power=None):
    """One slider whose slip by u raises its pressure: p = 1 + .9 u, u = 3.5 - w(p) while it slips."""

    def weights(t, p, past, slip):
        return coefficient * (p if power is None else p**power)

    slope = None if power is not None else lambda t, p, past: np.full((1, 1), coefficient)
    norms = vx.Norms([[1.0, 0.0]], 0.0, law=vx.Law(weights, slope=slope, slips=False))
    stiffness = [[1.0, -0.9], [-0.9, 1.0]]
    return vx.System(stiffness, lambda t: [3.5 * t, t], norms, limits=vx.Limits([[0.0, 1.0]], 0.0))


def test_a_solution_is_found_where_the_fixed_point_cycles():
    """With the coefficient 3 programs alone jump between stick and slip."""
    run = vx.march(wedge(3.0), [0.0, 1.0])
    u = (3.5 - 3.0) / (1 + 0.9 * 3.0)
    assert run.state[-1] == pytest.approx([u, 0.0], rel=1e-12)
    assert run.pressures[-1, 0] == pytest.approx(1 + 0.9 * u, rel=1e-12)
    assert run.certificate_kind == "for the given friction"
    assert run.certificate[-1] < 1e-12


@pytest.mark.parametrize("accuracy", [1e-2, 1e-4, 1e-6, 1e-8])
def test_laws_of_ones_own_without_a_slope(accuracy):
    """w = sqrt(p): u = 3.5 - sqrt(1 + .9 u), a quadratic equation."""
    u = 3.5 + 0.45 - np.sqrt((3.5 + 0.45) ** 2 - (3.5**2 - 1))
    run = vx.march(wedge(1.0, 0.5), [0.0, 1.0], solver=vx.Newton(accuracy=accuracy))
    assert run.certificate_kind == "for the given friction"
    assert run.certificate[-1] <= accuracy
    # dw/dp = 1 / (2 sqrt(p)) < 1/2: the law's own answer is no farther than twice what is certified.
    assert abs(run.state[-1, 0] - u) <= 2 * run.certified[-1] * run.norm[-1]


def test_the_derivative_of_a_law_has_a_row_a_term_and_a_column_a_limit():
    norms = vx.Norms([[1.0]], 0.0, law=vx.Law(lambda t, p, past, slip: p, slope=lambda t, p, past: np.ones((2, 1))))
    system = vx.System([[1.0]], lambda t: [t], norms, limits=vx.Limits([[1.0]], 0.0))
    with pytest.raises(vx.SceneError, match=r"^Norms: slope: found a matrix of shape \(2, 1\); wanted \(1, 1\)"):
        vx.march(system, [0.0, 1.0])


def resting(push=0.29, mu=0.3, young=200.0, press=1.0):
    """A block on a floor, pressed and pushed, and nothing else."""

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
def test_a_block_is_unloaded_to_zero_while_its_top_is_warmed(n):
    """A strain linear in y without a load is free of stress: nothing presses and nothing rubs where all is unloaded."""
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


@pytest.mark.long
def test_a_block_between_compliant_contacts_is_pressed_and_then_lifted():
    """Pressed with -.01 and dragged, then raised by .001: what is left are free bodies, without any force."""
    lower, upper = (vx.meshes.squares(1, box=((0, 1), (low, low + 0.4))) for low in (0.0, 0.4))
    ways = vx.Tabulated([0, 1, 2], [[0, 0], [0.015, -0.01], [-0.015, 0.001]])
    scene = vx.Scene(
        vx.Elasticity(young=1000.0, poisson=0.3),
        vx.PrescribedDisplacement(ways, on="upper.top"),
        vx.NormalCompliance(2000.0, on=["lower|upper", "lower.bottom"]),
        vx.CoulombFriction(1.0, on="lower|upper"),
        vx.CoulombFriction(0.4, on="lower.bottom"),
    )
    history = vx.simulate(scene, vx.meshes.bodies({"lower": lower, "upper": upper}), [0, 1, 2])
    contact = history.contact
    assert history.certificate.max() <= 1e-8
    # Pressed by what two springs of 1/2000 and two blocks in series bear, uniformly but for friction and Poisson.
    assert 3.0 < contact.pressure[1].mean() < 6.0
    assert contact.pressure[2].max() <= 1e-9 * contact.pressure[1].max()
    assert np.abs(history.forces[2]).max() <= 1e-8 * np.abs(history.forces[1]).max()
    assert history.energy[2] <= 1e-12 * history.energy[1]
    above = history.mesh.points[:, 1] > 0.4 + 1e-9
    assert history.displacement[2][above] == pytest.approx(np.tile([-0.015, 0.001], (above.sum(), 1)), abs=1e-9)


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
def test_a_body_that_only_friction_and_contact_hold_costs_what_others_do(given, size, solver, most):
    """It took 607 iterations a step at 6 x 6 cells, and 38,917 of steel; and the floor's reaction is the load."""
    mesh = vx.meshes.squares((6, 6) if size[0] == size[1] else (4, 1), box=((0, size[0]), (0, size[1])))
    history = vx.simulate(resting(**given), mesh, [0.0, 0.5, 1.0], initial="settled", solver=solver)
    push, press = given.get("push", 0.29) * size[1], given.get("press", 1.0)
    assert history.iterations.max() <= most
    assert history.certificate.max() <= solver.accuracy
    wanted = press * np.column_stack([-push * history.times, np.full(3, size[0])])
    assert history.force("bottom") == pytest.approx(wanted, abs=1e-9 * press)


@mostly_long("mu", [0.1, 0.4, 0.9], 1)
def test_what_sticks_where_two_obstacles_meet_is_held_twice(mu):
    """A block in the corner of a floor and a wall: one row follows from another there (86 iterations, once)."""
    rough = [e for on in ("bottom", "right") for e in (vx.UnilateralContact(on=on), vx.CoulombFriction(mu, on=on))]
    pressed = vx.Pressure(lambda x, t: t, on="top")
    pushed = vx.Traction(lambda x, t: [0.7 * t, 0.0], on="left")
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), pressed, pushed, *rough)
    history = vx.simulate(scene, vx.meshes.squares(3), np.linspace(0, 1, 4))
    assert history.iterations.max() <= 15
    assert history.certificate.max() <= 1e-12


@pytest.mark.long
def test_more_push_than_friction_holds_is_refused():
    with pytest.raises(vx.SceneError, match=r"with a force of 0\.\d+, .* at most 0\.3:"):
        vx.simulate(resting(0.5), vx.meshes.squares(3), np.linspace(0, 1, 5), initial="settled")


@pytest.mark.long
def test_answers_of_a_conic_solver_stay_its_own_until_they_are_polished():
    mesh, times = vx.meshes.squares(4), [0.0, 0.5, 1.0]
    plain, polished = (
        vx.simulate(HELD, mesh, times, initial="settled", solver=vx.Clarabel(1e-3, polish)) for polish in (False, True)
    )
    assert polished.certificate.max() < 1e-12 < 1e-11 < plain.certificate.max() <= 1e-3


def test_where_one_system_of_sets_is_too_few_clarabel_leads_to_the_answer():
    run, few = (
        vx.simulate(HELD, vx.meshes.squares(4), [0.0, 1.0], initial="settled", solver=vx.Newton(max_iterations=most))
        for most in (60, 1)
    )
    assert few.certificate[-1] <= 1e-8
    assert few.energy[-1] == pytest.approx(run.energy[-1], rel=1e-10)
    assert few.iterations[-1] > 10


@pytest.mark.long
def test_kinds_are_said_everywhere(tmp_path):
    """In the history, its words, and summary.json; where nothing follows the pressure, a certificate is a bound."""
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
