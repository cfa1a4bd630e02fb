"""Effects exert forces and moments. All forces balance."""

import json

import numpy as np
import pytest
from scenes import mostly_long, small

import gallery
import vemcvx as vx
from vemcvx.results import loop_of
from vemcvx.scene.pose import pose_scene, suppress_scene_warnings

EPS = float(np.finfo(float).eps)
STEEL = vx.Elasticity(1000.0, 0.3)


def assert_balanced(history, scene=None):
    """Check that the forces and loads balance in total and at every node."""
    acting = history.acting
    with suppress_scene_warnings():
        posed = pose_scene(scene or history.scene, history.mesh, history.trajectory.times.tolist())
    begin = int(posed.system.is_viscous)
    u = history.displacement.reshape(len(history.times), -1)
    rounding = 8 * EPS * (abs(posed.A) @ np.abs(u).T).sum(axis=0)
    left = np.abs(acting.force.sum(axis=1) + acting.loads.sum(axis=1))
    # Hoop stresses balance the sum of radial forces in a body of revolution.
    left = left[:, 1] if history.is_axisymmetric else left.max(axis=1)
    largest = max(np.abs(acting.force).max(initial=0.0), np.abs(acting.loads).max(initial=0.0))
    assert (left <= 1e-10 * largest + rounding)[begin:].all()
    springs = [i for i, words in enumerate(history.effects) if words.startswith("ElasticFoundation")]
    others = ~np.isin(acting.causes[:, 0], springs)
    between = [load for _, load in posed.caused_loads if load.between]
    nodal = np.zeros_like(history.forces)
    for row, forces in enumerate(acting.force[:, others]):
        np.add.at(nodal[row], acting.ends[others, 0], forces)
        for load in between:  # `history.forces` excludes loads that two bodies exert on each other.
            nodal[row] -= load.vector(history.times[row]).reshape(nodal[row].shape)
    off = np.abs(nodal - history.forces)
    if history.is_axisymmetric:  # No effect exerts the radial forces on the axis.
        off[:, history.mesh.points[:, 0] == 0.0, 0] = 0.0
    assert (off.max(axis=(1, 2)) <= 1e-10 * largest + rounding)[begin:].all()
    assert (acting.ends[acting.held, 1] >= -2).all()


@mostly_long("name", gallery.problem_files(), "plate_on_springs", "press_fit", "janssen_silo")
def test_every_problem_is_in_balance(name):
    problem = __import__(name)
    history = gallery.small_run(problem)
    assert_balanced(history, problem.stages()[-1][0] if hasattr(problem, "stages") else None)
    acting = history.acting
    sides = history._space.part("boundary", "test", contact=True).names
    there = acting.through(sides)
    assert (there | (acting.ends[:, 1] == -2)).all()
    whole = history.reaction("boundary") + history.force("boundary")
    assert whole == pytest.approx(acting.force[:, there].sum(axis=1), abs=1e-12 * np.abs(acting.force).max())


@pytest.fixture(scope="module")
def dragged():
    """A block that is dragged over another block, with the friction bound .6."""

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


def test_the_dragged_side_bears_all_friction(dragged, tmp_path):
    """The friction is .6 on a length of 1."""
    read = vx.read_history(dragged.write(tmp_path / "run"))
    for history in (dragged, read):
        assert history.reaction("up.left")[-1] == pytest.approx([0.6, 0.0], abs=1e-12)
        assert history.force("low|up")[-1] == pytest.approx([0.6, 0.0], abs=1e-12)
        assert history.force(vx.TrescaFriction(0.6, on="low|up"))[-1] == pytest.approx([0.6, 0.0], abs=1e-12)
        assert history.reaction("low.bottom")[-1] == pytest.approx([-0.6, 0.0], abs=1e-12)
    assert dragged.force(vx.BilateralContact)[-1] == pytest.approx([0.0, 0.0], abs=1e-12)
    # The moments on both bodies balance.
    assert dragged.moment("up.left")[-1] == pytest.approx(dragged.moment("low|up")[-1], abs=1e-12)
    about = (0.5, 0.0)
    moments = dragged.moment("low.bottom", about=about) + dragged.moment("low|up", about=about)
    assert moments == pytest.approx(0.0, abs=1e-12)


def test_planes_of_symmetry_share_no_force():
    pulls = vx.Pressure(2.0, on="right"), vx.Pressure(3.0, on="top")
    scene = vx.Scene(STEEL, vx.Symmetry(on=["left", "bottom"]), *pulls)
    history = vx.simulate(scene, small("voronoi", 5, seed=1), [0.0, 1.0], initial="settled")
    assert history.reaction("left")[-1] == pytest.approx([2.0, 0.0], abs=1e-12)
    assert history.reaction("bottom")[-1] == pytest.approx([0.0, 3.0], abs=1e-12)
    assert history.force(pulls[1])[-1] == pytest.approx([0.0, -3.0], abs=1e-12)


def test_springs_give_half_of_their_force_to_half_of_their_side():
    mesh = vx.meshes.squares(4).with_boundary("half", lambda x: (x[:, 1] < 1e-9) & (x[:, 0] < 0.5))
    springs = vx.ElasticFoundation(normal=10.0, tangential=5.0, on="bottom")
    sides = vx.Symmetry(on=["left", "right"])
    scene = vx.Scene(vx.Elasticity(1000.0, 0.0), springs, sides, vx.Pressure(1.0, on="top"))
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    assert history.force("bottom")[-1] == pytest.approx([0.0, 1.0], abs=1e-12)
    assert history.force("half")[-1] == pytest.approx([0.0, 0.5], abs=1e-12)
    assert history.moment("half")[-1] == pytest.approx(0.5 * 0.25, abs=0.02)
    assert not history.reaction("bottom")[-1].any()


@mostly_long("family", ["squares", "voronoi", "cubes"], 1, 2)
def test_sections_of_a_cantilever_carry_the_end_force_and_its_moment(family):
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


def test_a_section_includes_prestress():
    scene = vx.Scene(STEEL, vx.Clamp(on=["left", "right"]), vx.Prestress((3.0, 0.0, 0.0)), vx.Symmetry(on="bottom"))
    history = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], initial="settled")
    assert history.section((0.4, 0.5), (1.0, 0.0)).force[-1] == pytest.approx([3.0, 0.0], abs=1e-12)


def test_means_of_stresses_and_of_linear_displacements_are_exact(dragged):
    """The mean sigma_xy of `low` is the friction, .6. The mean of a linear field is the value at the centroid."""
    assert dragged.mean("stress", on="low")[-1][2] == pytest.approx(0.6, abs=1e-12)
    mesh, gradient = small("voronoi", 4, seed=2), np.array([[1e-3, 0], [2e-3, 3e-3]])
    stretch = vx.PrescribedDisplacement(lambda x, t: t * x @ gradient, on="boundary")
    linear = vx.simulate(vx.Scene(STEEL, stretch), mesh, [0.0, 1.0], initial="settled")
    centre = (mesh.measures @ mesh.centroids) / mesh.measures.sum()
    assert linear.mean("displacement")[-1] == pytest.approx(centre @ gradient, abs=1e-15)


def test_tables_and_summaries_contain_forces(dragged, tmp_path):
    columns = dragged.table("steps")
    assert np.array_equal(columns["reaction_up.left_x"], dragged.reaction("up.left")[:, 0])
    assert columns["force_low|up_x"][-1] == pytest.approx(0.6, abs=1e-12)
    told = json.loads((dragged.write(tmp_path / "run") / "summary.json").read_text())["forces"]
    assert told["reaction of up.left"]["value"] == pytest.approx([0.6, 0.0], abs=1e-12)
    assert told["reaction of up.left"]["step"] in (1, 2)
    assert "boundary" not in " ".join(told)


COHESIVE = vx.TrescaFriction(0.1, on="bottom")


@pytest.fixture(scope="module")
def pressed():
    floor = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom"), COHESIVE
    scene = vx.Scene(STEEL, vx.Clamp(on="left"), vx.Pressure(lambda x, t: t, on="top"), *floor)
    return vx.simulate(scene, vx.meshes.squares(3), [0.0, 1.0])


def test_the_loop_of_a_loaded_body_is_load_against_mean_displacement(pressed):
    """No support moves. The pressure 1 acts on a length of 1."""
    loop = loop_of(pressed)
    assert (loop.kind, loop.on, loop.axis) == ("load", "top", 1)
    assert loop.force == pytest.approx([0.0, -1.0], abs=1e-12)
    assert loop.motion[-1] < 0
    assert "Load of top" in vx.plots.hysteresis_loop(pressed).axes[0].get_title()


def test_the_reaction_of_a_contact_side_is_zero_and_a_hint_is_logged(pressed, caplog):
    assert not pressed.reaction("bottom").any()
    assert "history.force('bottom')" in caplog.text
    assert pressed.force("bottom")[-1, 1] > 0
