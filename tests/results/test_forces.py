"""Forces go with the effect that causes them, balance the loads, and pass sections of the body."""

import json

import numpy as np
import pytest
from scenes import mostly_long, small

import gallery
import vemcvx as vx
from vemcvx.results import loop_of
from vemcvx.results.forces import BoundaryForces
from vemcvx.scene.pose import pose_scene, suppress_scene_warnings

EPS = float(np.finfo(float).eps)
STEEL = vx.Elasticity(1000.0, 0.3)


def imbalance(history, scene=None):
    """Per row: all forces and loads, added up, and the rounding of A u, which nobody sees below."""
    with suppress_scene_warnings():
        posed = pose_scene(scene or history.scene, history.mesh, history.trajectory.times.tolist())
    acting, u = history.acting, history.displacement.reshape(len(history.times), -1)
    rounding = 8 * EPS * (abs(posed.A) @ np.abs(u).T).sum(axis=0)
    return np.abs(acting.force.sum(axis=1) + acting.loads.sum(axis=1)).max(axis=1), rounding


def assert_balanced(history, scene=None):
    """In all, and on every node; but at the start of what creeps, where no rate is known.

    `scene` is one with the material of a history that has none of its own.
    """
    acting, begin = history.acting, int(history.trajectory.velocity is not None)
    left, rounding = imbalance(history, scene)
    largest = max(np.abs(acting.force).max(initial=0.0), np.abs(acting.loads).max(initial=0.0))
    assert (left <= 1e-10 * largest + rounding)[begin:].all()
    sprung = np.isin(
        acting.causes[:, 0],
        [i for i, words in enumerate(history.effects) if words.startswith("ElasticFoundation")],
    )
    with suppress_scene_warnings():
        posed = pose_scene(scene or history.scene, history.mesh, history.trajectory.times.tolist())
    pulls = [load for _, load in posed.caused_loads if load.between]  # in acting, and among the loads of A u - f
    nodal = np.zeros_like(history.forces)
    for row, forces in enumerate(acting.force[:, ~sprung]):
        np.add.at(nodal[row], acting.ends[~sprung, 0], forces)
        for load in pulls:
            nodal[row] -= load.vector(history.times[row]).reshape(nodal[row].shape)
    assert (np.abs(nodal - history.forces).max(axis=(1, 2)) <= 1e-10 * largest + rounding)[begin:].all()
    assert (acting.ends[acting.held, 1] >= -2).all()


QUICK = "plate_on_springs", "press_fit", "janssen_silo"


@mostly_long("name", gallery.problem_files(), *QUICK)
def test_every_problem_is_in_balance(name):
    problem = __import__(name)
    history = gallery.small_run(problem)
    assert_balanced(history, problem.stages()[-1][0] if hasattr(problem, "stages") else None)
    # By boundary: every side has its part of each effect's force, and what has no side is across an interface.
    acting = history.acting
    sides = history._space.part("boundary", "test", contact=True).names
    there = acting.through(sides)
    assert (there | (acting.ends[:, 1] == -2)).all()
    whole = history.reaction("boundary") + history.force("boundary")
    assert whole == pytest.approx(acting.force[:, there].sum(axis=1), abs=1e-12 * np.abs(acting.force).max())


def pulled():
    """One block pulled over another by its side, over a bound of .6."""

    def block(y):
        return vx.meshes.squares(4, box=((0, 1), (y, y + 1)))

    scene = vx.Scene(
        STEEL,
        vx.Clamp(on="low.bottom"),
        vx.BilateralContact(on="low|up"),
        vx.TrescaFriction(0.6, on="low|up"),
        vx.PrescribedDisplacement(lambda x, t: np.full(len(x), 0.02 * t), on="up.left", direction=(1.0, 0.0)),
    )
    return vx.simulate(scene, vx.meshes.bodies({"low": block(-1), "up": block(0)}), [0, 1, 2])


@pytest.fixture(scope="module")
def dragged():
    return pulled()


def test_the_side_that_drags_bears_all_friction(dragged, tmp_path):
    """Friction is .6 on a length of 1, and the corner's part of it, which the side drags, is friction all the same."""
    read = vx.read_history(dragged.write(tmp_path / "run"))
    for history in (dragged, read):
        assert history.reaction("up.left")[-1] == pytest.approx([0.6, 0.0], abs=1e-12)
        assert history.force("low|up")[-1] == pytest.approx([0.6, 0.0], abs=1e-12)
        assert history.force(vx.TrescaFriction(0.6, on="low|up"))[-1] == pytest.approx([0.6, 0.0], abs=1e-12)
        assert history.reaction("low.bottom")[-1] == pytest.approx([-0.6, 0.0], abs=1e-12)
    assert dragged.force(vx.BilateralContact)[-1] == pytest.approx([0.0, 0.0], abs=1e-12)
    # Both bodies are in balance, of moments as well.
    assert dragged.moment("up.left")[-1] == pytest.approx(dragged.moment("low|up")[-1], abs=1e-12)
    assert dragged.moment("low.bottom", about=(0.5, 0.0)) == pytest.approx(
        -dragged.moment("low|up", about=(0.5, 0.0)), abs=1e-12
    )


def test_forces_on_another_body_are_none_of_an_edge():
    """Of node 2 on the other body, beside the edge from 1 to 3: the numbers of both pairs were one."""
    none = {"loads": np.zeros((1, 0, 2)), "load_causes": np.zeros(0, dtype=int), "held": np.zeros(2, dtype=bool)}
    ends = np.array([[2, -2], [1, 3]])
    acting = BoundaryForces(causes=np.array([[0, -1]] * 2), ends=ends, force=np.ones((1, 2, 2)), **none)
    assert acting.through(np.array([[1, 3]])).tolist() == [False, True]


def test_planes_of_symmetry_share_no_force():
    """A quarter under a pull and a push: across each plane its own stress, though they meet at a node."""
    scene = vx.Scene(
        STEEL, vx.Symmetry(on=["left", "bottom"]), vx.Pressure(2.0, on="right"), vx.Pressure(3.0, on="top")
    )
    history = vx.simulate(scene, small("voronoi", 5, seed=1), [0.0, 1.0], initial="settled")
    assert history.reaction("left")[-1] == pytest.approx([2.0, 0.0], abs=1e-12)
    assert history.reaction("bottom")[-1] == pytest.approx([0.0, 3.0], abs=1e-12)
    assert history.force(vx.Pressure(3.0, on="top"))[-1] == pytest.approx([0.0, -3.0], abs=1e-12)


def test_springs_and_parts_of_a_boundary():
    mesh = vx.meshes.squares(4).with_boundary("half", lambda x: (x[:, 1] < 1e-9) & (x[:, 0] < 0.5))
    springs = vx.ElasticFoundation(normal=10.0, tangential=5.0, on="bottom")
    sides = vx.Symmetry(on=["left", "right"])
    scene = vx.Scene(vx.Elasticity(1000.0, 0.0), springs, sides, vx.Pressure(1.0, on="top"))
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    assert history.force("bottom")[-1] == pytest.approx([0.0, 1.0], abs=1e-12)
    assert history.force("half")[-1] == pytest.approx([0.0, 0.5], abs=1e-12)
    assert history.moment("half")[-1] == pytest.approx(0.5 * 0.25, abs=0.02)
    assert history.reaction("bottom")[-1] == pytest.approx([0.0, 0.0], abs=0.0)


@mostly_long("family", ["squares", "voronoi", "cubes"], 1, 2)
def test_sections_of_a_cantilever(family):
    """Under a force on its end the shear is that force everywhere, and the moment grows with the distance."""
    dim = 3 if family == "cubes" else 2
    box = ((0, 4), (0, 1), (0, 1))[:dim]
    mesh = (vx.meshes.FAMILIES | vx.meshes.SPACE_FAMILIES)[family]((4, 2) if dim == 2 else (4, 2, 2), box=box)
    force = np.array([0.0, -2.0, 0.0])[:dim]
    scene = vx.Scene(STEEL, vx.Clamp(on="left"), vx.Traction(tuple(force), on="right"))
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    for x in (0.7, 1.6, 3.2):
        cut = history.section((x, *[0.5] * (dim - 1)), np.eye(dim)[0])
        assert cut.force[-1] == pytest.approx(force, abs=1e-11)
        assert np.ravel(cut.moment[-1])[-1] == pytest.approx(-2.0 * (4 - x), abs=1e-11)


def test_a_section_sees_stress_that_is_there_without_strain():
    scene = vx.Scene(STEEL, vx.Clamp(on=["left", "right"]), vx.Prestress((3.0, 0.0, 0.0)), vx.Symmetry(on="bottom"))
    history = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], initial="settled")
    assert history.section((0.4, 0.5), (1.0, 0.0)).force[-1] == pytest.approx([3.0, 0.0], abs=1e-12)


def test_means_over_bodies(dragged):
    """The mean of sigma_xy of the lower block is that of its top, .6; and a linear field has its centroid's value."""
    low = dragged.mean("stress", on="low")[-1]
    assert low[2] == pytest.approx(0.6, abs=1e-12)
    mesh = small("voronoi", 4, seed=2)
    stretch = vx.PrescribedDisplacement(lambda x, t: t * x @ np.array([[1e-3, 0], [2e-3, 3e-3]]), on="boundary")
    linear = vx.simulate(vx.Scene(STEEL, stretch), mesh, [0.0, 1.0], initial="settled")
    centre = (mesh.measures @ mesh.centroids) / mesh.measures.sum()
    assert linear.mean("displacement")[-1] == pytest.approx(centre @ np.array([[1e-3, 0], [2e-3, 3e-3]]), abs=1e-15)


def test_tables_and_summaries_have_forces(dragged, tmp_path):
    columns = dragged.table("steps")
    assert columns["reaction_up.left_x"] == pytest.approx(dragged.reaction("up.left")[:, 0], abs=0.0)
    assert columns["force_low|up_x"][-1] == pytest.approx(0.6, abs=1e-12)
    said = json.loads((dragged.write(tmp_path / "run") / "summary.json").read_text())["forces"]
    assert said["reaction of up.left"]["value"] == pytest.approx([0.6, 0.0], abs=1e-12)
    assert said["reaction of up.left"]["step"] in (1, 2)
    assert "boundary" not in " ".join(said)


def test_what_a_load_drives_has_a_loop(rubbed):
    """No support moves: the total of the pressure, 1 on a length of 1, against the mean motion of the top."""
    loop = loop_of(rubbed)
    assert (loop.kind, loop.on, loop.axis) == ("load", "top", 1)
    assert loop.force == pytest.approx([0.0, -1.0], abs=1e-12)
    assert loop.motion[-1] < 0
    assert "Load of top" in vx.plots.hysteresis_loop(rubbed).axes[0].get_title()


COHESIVE = vx.TrescaFriction(0.1, on="bottom")
MISTAKES = {
    "no boundary": (lambda h: h.force("botom"), "force: there is no boundary named 'botom'"),
    "no effect": (lambda h: h.force(vx.Clamp(on="right")), "force: found Clamp.*the effects of this history are"),
    "nothing": (lambda h: h.force(3), "force: found 3; wanted the name of a boundary, an effect, or a class"),
    "two effects": (lambda h: h.force(COHESIVE), "force: two effects share the force on some sides: .*TrescaF"),
    "a load": (lambda h: h.moment(vx.Pressure), "moment: found a load"),
    "a point": (lambda h: h.moment("left", about=(1.0,)), "moment: about: found an array of shape"),
    "no plane": (lambda h: h.section((0.5, 0.5), (0.0, 0.0)), "section: found a normal of length 0"),
    "no cut": (lambda h: h.section((5.0, 0.5), (1.0, 0.0)), "section: the plane through .* does not cut the body"),
    "no field": (lambda h: h.mean("strain"), "mean: there is no field 'strain'; there are 'displacement'"),
    "no cells": (lambda h: h.mean(on="core"), "mean: on= names cells by a cell datum"),
}


@pytest.fixture(scope="module")
def rubbed():
    floor = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom"), COHESIVE
    scene = vx.Scene(STEEL, vx.Clamp(on="left"), vx.Pressure(lambda x, t: t, on="top"), *floor)
    return vx.simulate(scene, vx.meshes.squares(3), [0.0, 1.0])


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_named(rubbed, mistake):
    ask, says = MISTAKES[mistake]
    with pytest.raises(vx.SceneError, match=says):
        ask(rubbed)


def test_a_reaction_of_contact_is_said_to_be_none(rubbed, caplog):
    assert not rubbed.reaction("bottom").any()
    assert "history.force('bottom') is the contact force" in caplog.text
    assert rubbed.force("bottom")[-1, 1] > 0
