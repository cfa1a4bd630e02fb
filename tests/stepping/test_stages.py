"""Stages: a run that begins where another one ended goes on as one run would, for another scene on the same mesh."""

import numpy as np
import pytest
from scenes import mostly_long

import slip_weakening as weak
import vemcvx as vx


def blocks(n):
    """Two blocks, one on the other."""
    boxes = {"low": ((0, 1), (0, 0.5)), "up": ((0, 1), (0.5, 1))}
    return vx.meshes.bodies({name: vx.meshes.squares(n, box=box) for name, box in boxes.items()})


MESH = blocks(2)


def pulled(law, out=(0.0, 0.02)):
    """A block on a block: pressed, and pulled along by `out` of its way, which is one at t = 1 and two at t = 2."""
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
def test_two_stages_are_one_run(name, tmp_path):
    scene, times = pulled(LAWS[name]), np.linspace(0.0, 2.0, 9)
    whole = vx.simulate(scene, MESH, times)
    first = vx.simulate(scene, MESH, times[:5])
    first.write(tmp_path / "first")
    for begun in (first, tmp_path / "first"):
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


@pytest.mark.long
def test_a_law_of_slip_reads_the_way_of_both_stages():
    """In the closed form of the problem file friction weakens with the whole way: it turns after the first stage."""
    scene, mesh, times = weak.scene(), weak.mesh(3), weak.times(40)
    first = vx.simulate(scene, mesh, times[:17])
    second = vx.simulate(scene, mesh, times[16:], initial=first)
    q, _ = weak.closed_form(times)
    moved = -second.contact.traction[1:, :, 0]
    np.testing.assert_allclose(np.abs(moved), np.abs(q[17:])[:, None] * np.ones(moved.shape[1]), rtol=1e-6)


def test_the_second_scene_may_have_other_effects():
    """A pad is pressed by a load; then the load stays, and its side is pulled: one run with both would do the same."""
    press = lambda t: 5.0 * min(2 * t, 1.0)  # noqa: E731
    pad, times = vx.meshes.squares(4), np.linspace(0, 1, 9)
    common = (
        vx.Elasticity(1000.0, 0.3),
        vx.Clamp(on="left"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
    )

    def scene(*more):
        return vx.Scene(*common, vx.Pressure(lambda x, t: press(t), on="top"), *more)

    pull = vx.Traction(lambda x, t: [2.0 * max(t - 0.5, 0.0), 0.0], on="right")
    whole = vx.simulate(scene(pull), pad, times)
    first = vx.simulate(scene(), pad, times[:5])
    second = vx.simulate(scene(pull), pad, times[4:], initial=first)
    size = np.abs(whole.displacement).max()
    np.testing.assert_allclose(second.displacement, whole.displacement[4:], rtol=0, atol=1e-6 * size)
    np.testing.assert_allclose(second.dissipated, whole.dissipated[4:], rtol=0, atol=1e-6 * whole.energy.max())


def test_what_cannot_go_on_is_refused():
    scene, times = pulled(LAWS["Coulomb"]), np.linspace(0.0, 1.0, 5)
    first = vx.simulate(scene, MESH, times)
    with pytest.raises(vx.SceneError, match="another mesh"):
        vx.simulate(scene, blocks(4), times, initial=first)
    other = pulled([*LAWS["Coulomb"], vx.Pressure(20.0, on="up.top")])
    with pytest.raises(vx.SceneError, match=r"initial: .*loads and supports that it ended with"):
        vx.simulate(other, MESH, [1.0, 2.0], initial=first)
    with pytest.raises(vx.SceneError, match="contradicts its supports"):
        vx.simulate(scene, MESH, times, initial=first)
