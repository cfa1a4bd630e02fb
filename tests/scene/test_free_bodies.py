"""Bodies without supports: displacements have no mean rigid motion, and loads must balance."""

import numpy as np
import pytest

import vemcvx as vx

FAMILIES = vx.meshes.FAMILIES | vx.meshes.SPACE_FAMILIES
E, NU = 200.0, 0.3
STEEL = vx.Elasticity(E, NU)
BAR = ((0.0, 4.0), (0.0, 1.0), (0.0, 1.0))


def settled(mesh, *effects, times=(0.0, 1.0)):
    return vx.simulate(vx.Scene(*effects), mesh, times, initial="settled")


def check_rest(history):
    """Check that there are no reactions, and that the mean displacement vanishes."""
    assert np.abs(history.reaction("boundary")).max() == 0.0
    assert np.abs(history.mean("displacement")).max() <= 1e-13 * np.abs(history.displacement).max()
    assert any(words.startswith("the motion of the whole body: nothing holds it") for words in history.inactive)


@pytest.mark.parametrize(("family", "n"), [("squares", (8, 2)), ("voronoi", 5), ("cubes", (4, 1, 1))])
def test_a_bar_pulled_at_both_ends_stretches_about_its_middle(family, n):
    """About the middle, u = (s x / E, -nu s y / E) under the stress s, in plane stress and in space."""
    dim = 3 if family == "cubes" else 2
    mesh = FAMILIES[family](n, box=BAR[:dim])
    pull = 3.0 * np.eye(dim)[0]
    material = vx.Elasticity(E, NU, plane="stress") if dim == 2 else STEEL
    history = settled(mesh, material, vx.Traction(pull, on="right"), vx.Traction(-pull, on="left"))
    strain = 3.0 / E * np.where(np.arange(dim) == 0, 1.0, -NU)
    exact = (mesh.points - [np.mean(side) for side in BAR[:dim]]) * strain
    assert history.displacement[-1] == pytest.approx(exact, abs=1e-13)
    assert history.section(np.full(dim, 0.4), np.eye(dim)[0]).force[-1] == pytest.approx(pull, abs=1e-11)
    check_rest(history)


def tube(angle, sectors, *held):
    mesh = vx.meshes.ring(np.linspace(1.0, 1.8, 5), sectors, angles=(0.0, angle))
    pressures = (
        vx.Pressure(lambda x, t, p=p: np.full(len(x), p * t), on=on) for p, on in ((3.0, "inner"), (1.0, "outer"))
    )
    return vx.Scene(STEEL, *pressures, *held), mesh


def test_a_whole_tube_under_pressure_has_lames_displacement():
    """The squared error bound is four times the squared bound of a quarter tube. Relative estimates are equal."""
    history, quarter = (
        vx.simulate(*tube(*arguments), [0.0, 1.0])
        for arguments in ((2 * np.pi, 32), (np.pi / 2, 8, vx.Symmetry(on=["first", "last"])))
    )
    points = history.mesh.points
    A, B = (3.0 - 1.8**2) / (1.8**2 - 1), 2.0 * 1.8**2 / (1.8**2 - 1)
    exact = (1 + NU) / E * ((1 - 2 * NU) * A + B / np.sum(points**2, axis=1))[:, None] * points
    assert history.displacement[-1] == pytest.approx(exact, abs=0.02 * np.abs(exact).max())
    check_rest(history)
    one, four = (vx.error_bound(of, 1) for of in (quarter, history))
    assert four.upper**2 == pytest.approx(4 * one.upper**2, rel=1e-6)
    assert four.lower <= four.upper
    one, four = (vx.error_budget(of).largest["space"] for of in (quarter, history))
    assert four == pytest.approx(one, rel=1e-6)


def test_a_run_continues_from_a_run_and_from_any_rigid_motion_of_its_state():
    scene, mesh = tube(2 * np.pi, 12)
    first = vx.simulate(scene, mesh, [0.0, 1.0])
    whole = vx.simulate(scene, mesh, [0.0, 1.0, 2.0])
    moved = first.displacement[-1] + [5.0, -2.0] + 0.1 * mesh.points[:, ::-1] * [-1.0, 1.0]
    for initial in (first, moved):
        then = vx.simulate(scene, mesh, [1.0, 2.0], initial=initial)
        assert then.displacement == pytest.approx(whole.displacement[1:], abs=1e-13)


def test_bodies_joined_by_friction_float_together():
    """Two blocks are pressed together. With friction, they float as one body. Without friction, they are refused."""
    box = {"low": (-1.0, 0.0), "up": (0.0, 1.0)}
    mesh = vx.meshes.bodies({name: vx.meshes.squares(3, box=((0, 1), high)) for name, high in box.items()})
    rub = vx.UnilateralContact(on="low|up"), vx.CoulombFriction(0.5, on="low|up")
    history = settled(mesh, STEEL, vx.Pressure(2.0, on=["low.bottom", "up.top"]), *rub)
    assert history.contact.pressure[-1] == pytest.approx(2.0, abs=1e-10)
    assert history.force("low|up")[-1] == pytest.approx([0.0, -2.0], abs=1e-11)
    check_rest(history)
    with pytest.raises(
        vx.SceneError, match=r"^supports: the body floats: neither a support nor friction prevents 1 rigid motion:"
    ):
        settled(mesh, STEEL, vx.Pressure(2.0, on=["low.bottom", "up.top"]), rub[0])
