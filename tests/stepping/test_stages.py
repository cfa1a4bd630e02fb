"""Stages: a run continues at the end of another run."""

import numpy as np
import pytest
from scenes import mostly_long

import pressed_then_sheared as pressed
import vemcvx as vx
from vemcvx.results import loop_of


def blocks(n):
    """Return two stacked blocks."""
    boxes = {"low": ((0, 1), (0, 0.5)), "up": ((0, 1), (0.5, 1))}
    return vx.meshes.bodies({name: vx.meshes.squares(n, box=box) for name, box in boxes.items()})


MESH, SIDES = blocks(2), ["left", "right"]


def pulled(law, out=(0.0, 0.02)):
    """Return the scene of two blocks. The upper block's left side has moved by out[0] at t = .5, by out[1] at t = 2."""
    return vx.Scene(
        vx.Elasticity(young=1000.0, poisson=0.3),
        vx.Clamp(on="low.bottom"),
        vx.UnilateralContact(on="low|up"),
        vx.Pressure(lambda x, t: 5.0 * min(2 * t, 1.0), on="up.top"),
        vx.PrescribedDisplacement(lambda x, t: np.interp(t, [0.5, 2.0], out), on="up.left", direction=(1, 0)),
        *law,
    )


LAWS = {"Tresca": [vx.TrescaFriction(1.0, on="low|up")], "Coulomb": [vx.CoulombFriction(0.3, on="low|up")]}


@mostly_long("name", LAWS, "Coulomb")
def test_two_stages_equal_one_run(name, tmp_path):
    scene, times = pulled(LAWS[name]), np.linspace(0.0, 2.0, 9)
    whole = vx.simulate(scene, MESH, times)
    first = vx.simulate(scene, MESH, times[:5])
    first.write(tmp_path / "first")
    for begun in (first, vx.read_history(tmp_path / "first")):
        second = vx.simulate(scene, MESH, times[4:], initial=begun)
        assert second.certified.max() <= 1e-6
        of_whole = {"displacement": whole.displacement, "dissipated": whole.dissipated, "work": whole.work}
        of_whole |= {"work_second_order": whole.work_second_order, "energy": whole.energy}
        for what, values in of_whole.items():
            np.testing.assert_allclose(
                getattr(second, what), values[4:], rtol=0, atol=1e-7 * np.abs(values).max(), err_msg=what
            )
        for what in ("wear", "wear_second_order", "accumulated_slip"):
            values = getattr(whole.contact, what)
            assert values[-1].max() > 0
            np.testing.assert_allclose(
                getattr(second.contact, what), values[4:], rtol=0, atol=1e-7 * values.max(), err_msg=what
            )


def test_wear_continues_if_the_next_mesh_names_the_bodies_of_an_interface_in_another_order():
    boxes = {"low": ((0, 1), (0, 0.5)), "up": ((0, 1), (0.5, 1))}
    turned = {name: vx.meshes.squares(2, box=box) for name, box in boxes.items()}
    turned = vx.meshes.bodies(turned, interfaces={"low|up": ("up", "low")})
    scene, times = pulled(LAWS["Coulomb"]), np.linspace(0.0, 2.0, 5)
    first = vx.simulate(scene, MESH, times[:4])
    one, other = (vx.simulate(scene, mesh, times[3:], initial=first).contact for mesh in (MESH, turned))
    at = np.argsort(one.points[:, 0]), np.argsort(other.points[:, 0])
    for what in ("wear", "accumulated_slip"):
        values, found = (getattr(contact, what)[-1, k] for contact, k in zip((one, other), at, strict=True))
        assert found == pytest.approx(values, abs=1e-6 * values.max())


def test_wrong_continuations_are_refused():
    scene, times = pulled(LAWS["Coulomb"]), np.linspace(0.0, 1.0, 5)
    first = vx.simulate(scene, MESH, times)
    with pytest.raises(vx.SceneError, match="another mesh"):
        vx.simulate(scene, blocks(4), times, initial=first)
    other = pulled([*LAWS["Coulomb"], vx.Pressure(20.0, on="up.top")])
    with pytest.raises(vx.SceneError, match=r"initial: .*loads and supports must begin as they ended in that history"):
        vx.simulate(other, MESH, [1.0, 2.0], initial=first)
    with pytest.raises(vx.SceneError, match="contradicts its supports"):
        vx.simulate(scene, MESH, times, initial=first)


@pytest.mark.filterwarnings("ignore:supports")
def test_joined_stages_follow_the_closed_form(tmp_path):
    """A block is pressed, then sheared."""
    mesh, ((press, before), (shear, after)) = pressed.mesh(2), pressed.stages()
    first = vx.simulate(press, mesh, before)
    second = vx.simulate(shear, mesh, after, initial=first)
    both, (gamma, a) = vx.joined([first, second]), pressed.exact_solution()
    assert both.times.tolist() == [*before, *after[1:]]
    assert both.stored.tolist() == list(range(len(both.times)))
    y, begun = mesh.points[:, 1], len(before) - 1
    exact = np.stack([a[:, None] + gamma[:, None] * y, np.tile(-pressed.PRESSURE * y / pressed.YOUNG, (len(a), 1))], 2)
    assert both.displacement[begun:] == pytest.approx(exact, abs=1e-9 * np.abs(exact).max())
    area, most = pressed.LENGTH * pressed.HEIGHT, pressed.COEFFICIENT * pressed.PRESSURE
    energy = (pressed.PRESSURE**2 / pressed.YOUNG + pressed.MU * gamma**2) * area / 2
    lost = most * pressed.LENGTH * np.append(0.0, np.abs(np.diff(a)).cumsum())
    assert both.energy[begun:] == pytest.approx(energy, rel=1e-8)
    assert both.dissipated[begun:] == pytest.approx(lost, abs=1e-8 * lost[-1])
    assert both.work_second_order[begun:] == pytest.approx(energy + lost, rel=1e-8)
    pulls = both.reaction("top")
    assert pulls[begun:, 0] == pytest.approx(pressed.MU * gamma * pressed.LENGTH, abs=1e-7)
    loop = loop_of(both)  # force against displacement of the top
    assert (loop.on, loop.axis) == ("top", 0)
    assert np.array_equal(loop.force, pulls[:, 0])
    contact = both.contact
    assert contact.wear[-1] @ contact.friction_lengths == pytest.approx(lost[-1], rel=1e-8)
    table = both.table("steps")
    assert np.array_equal(table["reaction_top_x"], pulls[:, 0])
    assert table["dissipated"][-1] == both.dissipated[-1] == second.dissipated[-1]
    read = vx.read_history(both.write(tmp_path / "both"))
    assert np.array_equal(read.contact.pressure, contact.pressure)
    assert read.force("bottom")[-1] == pytest.approx([-most * pressed.LENGTH, pressed.PRESSURE * pressed.LENGTH])


@pytest.mark.filterwarnings("ignore:supports")
def test_an_effect_acts_in_its_own_stage_and_its_wear_remains():
    """A pad is pressed on a smooth floor, slides with friction, and rests on a smooth floor again."""
    pad, common = vx.meshes.squares(2), (vx.Elasticity(1000.0, 0.0), vx.UnilateralContact(on="bottom"))
    press = vx.Pressure(lambda x, t: 5.0 * min(t, 1.0), on="top")
    move = vx.PrescribedDisplacement(lambda x, t: np.interp(t, [1, 2], [0, 0.1]), on=SIDES, direction=(1, 0))
    rub = vx.TrescaFriction(lambda x, t: np.interp(t, [2, 3], [0.5, 0.0]), on="bottom")
    stages = []
    for more, times in (([], [0.0, 0.5, 1.0]), ([rub], [1.0, 1.5, 2.0, 3.0]), ([], [3.0, 4.0])):
        scene = vx.Scene(*common, press, move, *more)
        stages.append(vx.simulate(scene, pad, times, initial=stages[-1] if stages else None))
    both = vx.joined(stages)
    assert both.times.tolist() == [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0]
    assert both.force(rub)[:, 0] == pytest.approx([0, 0, 0, -0.5, -0.5, 0, 0], abs=1e-8)
    assert both.force(press)[-1] == pytest.approx([0.0, -5.0])
    worn = both.contact.wear @ both.contact.friction_lengths
    assert worn[:3].tolist() == [0, 0, 0]
    assert worn[3:] == pytest.approx([*both.dissipated[3:6], both.dissipated[5]], rel=1e-8)
    assert worn[4] == pytest.approx(0.05, rel=0.01)
    assert not stages[2].contact.wear.any()
    assert both.contact.pressure[-1] == pytest.approx(5.0)
    assert both.contact.slip[-1, :, 0] == pytest.approx(0.1)


def test_histories_that_do_not_continue_each_other_are_not_joined():
    scene, times = pulled(LAWS["Tresca"]), np.linspace(0.0, 2.0, 5)
    first = vx.simulate(scene, MESH, times[:3])
    with pytest.raises(vx.HistoryError, match="joined: stage 2 does not continue stage 1: it begins at t = 0, but"):
        vx.joined([first, first])
    alone = vx.simulate(scene, MESH, times[2:], initial=first.displacement[-1])
    with pytest.raises(vx.HistoryError, match="`dissipated` begins at 0, but the stage before it ended with"):
        vx.joined([first, alone])
    last = vx.simulate(scene, MESH, times[2:], initial=first, store="last")
    with pytest.raises(vx.HistoryError, match="its initial instant was not stored"):
        vx.joined([first, last])
    finer = vx.simulate(scene, blocks(4), times[:3])
    with pytest.raises(vx.HistoryError, match="it is on another mesh"):
        vx.joined([finer, vx.simulate(scene, MESH, times[2:], initial=first)])
    with pytest.raises(vx.HistoryError, match="joined: found .*wanted a list of histories, one for each stage"):
        vx.joined([first, "second"])
