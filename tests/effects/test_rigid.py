"""Rigid parts with unknown motions and balanced forces."""

import numpy as np
import pytest

import vemcvx as vx

STEEL = vx.Elasticity(200.0, 0.3)
BLOCK = vx.meshes.squares((8, 4), box=((0, 2), (0, 1)))


def pressed(n):
    box = (0.25, 0.75), (1, 1.5)
    parts = {"low": vx.meshes.squares(8, box=((0, 1), (0, 1))), "tool": vx.meshes.squares(n, box=box)}
    return vx.meshes.bodies(parts), vx.Clamp(on="low.bottom"), vx.UnilateralContact(on="low|tool")


def test_a_bar_with_a_rigid_end_stretches_uniformly():
    """A bar of length L and area A under the force F has the displacement F L / (E A) at the end."""
    scene = vx.Scene(vx.Elasticity(200.0, 0.0), vx.Clamp(on="left"), vx.Rigid(on="right", force=(3.0, 0.0)))
    history = vx.simulate(scene, vx.meshes.voronoi(5, seed=1), [0.0, 1.0], initial="settled")
    end = history.displacement[-1][np.unique(history.mesh.boundaries["right"])]
    assert end == pytest.approx(np.tile([3.0 / 200.0, 0.0], (len(end), 1)), abs=1e-15)
    assert history.reaction("right")[-1] == pytest.approx([0.0, 0.0], abs=1e-13)
    assert history.reaction("left")[-1] == pytest.approx([-3.0, 0.0], abs=1e-13)
    assert history.force(vx.Rigid)[-1] == pytest.approx([3.0, 0.0], abs=1e-13)


@pytest.mark.parametrize("point", [(1.3, 0.0), (41.0, 7.0)])
def test_a_rigid_plate_on_a_bed_of_springs_tilts(point):
    k, F, M = 50.0, 4.0, 0.3
    at = np.array(point)
    rigid = vx.Rigid(on="bottom", at=point, force=(0.0, -F), moment=M)
    scene = vx.Scene(STEEL, vx.ElasticFoundation(normal=k, tangential=1.0, on="bottom"), rigid)
    history = vx.simulate(scene, BLOCK, [0.0, 1.0], initial="settled")
    turn = (M - F * (at[0] - 1.0)) / (k * 2.0**3 / 12)
    wanted = -F / (k * 2.0) + turn * (BLOCK.points[:, 0] - 1.0)
    assert history.displacement[-1][:, 1] == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize(("n", "near"), [(4, 0.021), pytest.param(8, 0.009, marks=pytest.mark.long)])
def test_a_rigid_punch_has_the_pressure_of_a_half_plane(n, near):
    """p = P (1 + 2 e x / a^2) / (pi sqrt(a^2 - x^2)) under a punch of half width a, with the force P at x = e.

    The part abs(x) < a / 2 bears P / 3. The part x > 0 bears (1/2 + 2 e / (pi a)) P.
    """
    below, tool = vx.meshes.squares((16 * n, 8 * n), box=((-8, 8), (-8, 0))), ((-1, 1), (0, 1))
    mesh = vx.meshes.bodies({"low": below, "tool": vx.meshes.squares((2 * n, 1), box=tool)})
    own = vx.simulate(punch(0.0), mesh, [0.0, 1.0]), vx.simulate(punch(0.2), mesh, [0.0, 1.0])
    through = own[0].acting.through(own[0]._space.part("low|tool", "test", contact=True).names)
    x = mesh.points[own[0].acting.ends[through, 0], 0]
    centred, eccentric = (-history.acting.force[-1, through, 1] for history in own)
    within = np.where(np.isclose(np.abs(x), 0.5), 0.5, np.abs(x) < 0.5)
    right = np.where(np.isclose(x, 0.0, atol=1e-9), 0.5, x > 0)
    assert centred.sum() == pytest.approx(1.0, abs=1e-12)
    assert within @ centred == pytest.approx(1 / 3, abs=near)
    assert right @ eccentric == pytest.approx(0.5 + 0.4 / np.pi, abs=near / 2)


def punch(e):
    """Return the scene of a rigid tool that can turn, under a vertical force at x = e."""
    rigid = vx.Rigid(on="tool", at=(e, 0.0), force=lambda x, t: (0.0, -t), motion=(0.0, None, None))
    return vx.Scene(STEEL, vx.Clamp(on="low.bottom"), vx.UnilateralContact(on="low|tool"), rigid)


def test_a_prescribed_motion_and_its_reaction_as_a_load_give_the_same_answer():
    """The second run applies the reaction of the first run as a load."""
    mesh, clamp, _ = pressed(4)
    round_ = vx.UnilateralContact(on="low|tool", gap=lambda x, t: 0.2 * (x[:, 0] - 0.53) ** 2)

    def run(**of):
        return vx.simulate(vx.Scene(STEEL, clamp, round_, vx.Rigid(on="tool.top", **of)), mesh, [0.0, 0.5, 1.0])

    by_motion = run(motion=(0.0, lambda x, t: -0.01 * t, 0.0))
    F = by_motion.reaction("tool.top")
    assert F[-1, 1] < -0.5
    assert by_motion.force(vx.Rigid) == pytest.approx(F, abs=1e-14)
    M = vx.Tabulated(by_motion.times, by_motion.moment("tool.top", about=(0.5, 1.5)))
    by_force = run(force=vx.Tabulated(by_motion.times, F), moment=M, motion=(0.0, None, None))
    assert by_force.displacement == pytest.approx(by_motion.displacement, abs=1e-9 * 0.01)
    assert by_force.reaction("tool.top")[-1] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert by_force.force(vx.Rigid)[-1] == pytest.approx(F[-1], abs=1e-12)


def test_a_rigid_body_is_the_limit_of_stiff_bodies():
    mesh, clamp, contact = pressed(2)
    load = vx.Traction(lambda x, t: np.tile([0.2 * t, -2.0 * t], (len(x), 1)), on="tool.top")
    rest = clamp, contact, vx.CoulombFriction(0.3, on="low|tool"), load
    stiff = vx.Elasticity(200.0, 0.3, on="low"), vx.Elasticity(200e6, 0.3, on="tool")
    found = [vx.simulate(vx.Scene(*own, *rest), mesh, [0, 0.5, 1]) for own in (stiff, (STEEL, vx.Rigid(on="tool")))]
    apart = np.abs(found[0].displacement - found[1].displacement).max()
    assert apart < 3e-6 * np.abs(found[1].displacement).max()
    # A force at the middle of the top replaces the traction.
    at = vx.Rigid(on="tool", at=(0.5, 1.5), force=lambda x, t: (0.1 * t, -t))
    same = vx.simulate(vx.Scene(STEEL, *rest[:-1], at), mesh, [0, 0.5, 1])
    assert same.displacement == pytest.approx(found[1].displacement, abs=1e-12)


def test_a_rigid_tool_in_space_is_in_balance():
    cubes = vx.meshes.cubes
    low, tool = cubes(2, box=((0, 1), (0, 1), (0, 1))), cubes(1, box=((0.25, 0.75), (0.25, 0.75), (1, 1.5)))
    mesh = vx.meshes.bodies({"low": low, "tool": tool})
    scene = vx.Scene(
        STEEL,
        vx.Clamp(on="low.bottom"),
        vx.UnilateralContact(on="low|tool"),
        vx.CoulombFriction(0.3, on="low|tool"),
        vx.Rigid(on="tool", force=lambda x, t: (0.1 * t, 0.0, -t), moment=lambda x, t: (0.01 * t, 0.0, 0.02 * t)),
    )
    history = vx.simulate(scene, mesh, [0.0, 0.5, 1.0])
    assert history.reaction("low.bottom")[-1] == pytest.approx([-0.1, 0.0, 1.0], abs=1e-12)
    about = (0.5, 0.5, 1.25)
    assert history.moment("low.bottom", about=about)[-1] == pytest.approx([-0.01, 0.0, -0.02], abs=1e-12)
    assert history.force("low|tool")[-1] == pytest.approx([0.1, 0.0, -1.0], abs=1e-12)
