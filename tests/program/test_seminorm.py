"""Bodies that only friction and contact hold, so that the stiffness matrix has a kernel."""

import numpy as np
import pytest
from scenes import few_families, mostly_long, small

import vemcvx as vx
from vemcvx.program import Kernel
from vemcvx.scene import pose_scene

TIMES = np.linspace(0.0, 1.0, 9)
BOUND = 4.0
ALONE = "nothing but friction or one-sided contact holds the body against the translation"


def make_slab(pull, course=np.sin):
    """Return a block on a rough floor. The traction pull * course(t) acts on the left side."""
    return vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Traction(lambda x, t: np.column_stack([np.full(len(x), pull * course(t)), np.zeros(len(x))]), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=BOUND, on="bottom"),
    )


@few_families
@mostly_long("condense", [True, False])
@mostly_long("share", [0.1, 0.97], 1)
def test_friction_alone_holds_the_body(family, share, condense):
    """A warning says that the solution is not unique."""

    def swing(t):
        return np.sin(2 * np.pi * t)

    with pytest.warns(vx.SceneWarning, match=ALONE):
        history = vx.simulate(make_slab(share * BOUND, swing), small(family, 6), TIMES, condense=condense)
    assert history.certificate.max() <= 1e-8
    assert np.abs(history.force("bottom")[:, 0] + share * BOUND * swing(TIMES)).max() < 1e-9 * BOUND
    numerical = history.work - (history.energy - history.energy[0]) - history.dissipated
    assert (np.diff(numerical) > -1e-12 * history.work.max()).all()


def test_too_much_load_is_refused_with_the_missing_force():
    message = r"^step 8 at t = 1: .* the translation \(1, 0\) of the body.* force of 4\.2, .* at most 4: 0\.2"
    with pytest.warns(vx.SceneWarning, match=ALONE), pytest.raises(vx.SceneError, match=message):
        vx.simulate(make_slab(4.2, lambda t: t), vx.meshes.squares(4), TIMES)


def test_a_chain_of_two_sliders_stretches_by_the_load_above_the_first_bound():
    """A spring of stiffness 10 joins blocks with the friction bounds 1 and 2. The load pulls the first block."""
    K = 10.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    kernel = Kernel(np.ones((2, 1)), ("sliding together",))
    system = vx.System(K, lambda t: [2.5 * t, 0.0], vx.Norms(np.eye(2), [1.0, 2.0]), kernel=kernel)
    result = vx.march(system, np.linspace(0, 1, 6))
    stretch = result.state[:, 0] - result.state[:, 1]
    assert stretch == pytest.approx(np.maximum(2.5 * result.times - 1.0, 0.0) / 10, abs=1e-9)
    assert np.abs(result.state[:, 1]).max() < 1e-9
    assert result.certificate.max() < 1e-8
    # Only the first block slips, against the friction bound 1.
    assert result.dissipated[-1] == pytest.approx(result.state[-1, 0], rel=1e-9)
    assert result.multipliers[-1, :, 0].sum() == pytest.approx(2.5, rel=1e-12)


@pytest.mark.arithmetic
@mostly_long("far", [1.0, 1e2, 1e4, 1e8], 1, 3)
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()], ids=lambda s: s.name)
def test_friction_drags_a_body_over_any_distance(far, solver):
    """A carriage drags node 1. A spring joins nodes 1 and 2. Friction holds node 2."""
    K = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    body = Kernel(np.array([[1.0], [1.0], [0.0]]), ("the translation",))
    terms = vx.Norms(np.array([[1.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), np.array([1.0, 0.5]))
    run = vx.march(vx.System(K, lambda t: np.array([0.0, 0.0, far * t]), terms, kernel=body), [0.0, 1.0], solver=solver)
    wanted = np.array([far - 0.5, far - 1.0, far - 0.5]) if far > 1.0 else np.array([0.5, 0.0, 0.5])
    allowed = run.certificate[-1] * run.norm[-1] + 1e-12 * far
    assert np.sqrt((K @ (run.state[-1] - wanted)) @ (run.state[-1] - wanted)) <= allowed
    assert np.abs(run.multipliers[-1].ravel() - [-0.5, 0.5]).max() <= allowed


@mostly_long("beyond", [1e-3, 1e-8, 1e-10])
@pytest.mark.parametrize("tips", [False, True])
@pytest.mark.filterwarnings(f"ignore:.*{ALONE}")
def test_loads_just_beyond_the_limit_are_refused(beyond, tips):
    """A block of weight 1 slides under a push of 0.3 if mu = 0.3. With more friction, it tips under a push of 1."""
    push = (1.0 if tips else 0.3) * (1 + beyond)
    sides = ["left"] if tips else ["left", "right"]
    scene = vx.Scene(
        vx.Elasticity(young=1000.0, poisson=0.3),
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(bound=5.0, on="bottom") if tips else vx.CoulombFriction(0.3, on="bottom"),
        vx.Traction((0.0, -1.0), on="top"),
        vx.Traction(lambda x, t: [push * t / len(sides), 0.0], on=sides),
    )
    # If the excess is tiny, the refusal may be NotCertified.
    refused = (vx.SceneError, vx.NotCertified) if beyond <= 1e-9 else vx.SceneError
    reason = "" if beyond <= 1e-9 else ".* there is no equilibrium"
    with pytest.raises(refused, match=f"^step 2 at t = 1: {reason}"):
        vx.simulate(scene, vx.meshes.squares(3), [0.0, 0.5, 1.0], initial="settled")


@pytest.mark.filterwarnings(f"ignore:.*{ALONE}")
def test_a_cube_that_slides_and_turns_without_limit_is_refused():
    """The left side of a cube is pushed obliquely. Friction balances a push of at most 0.2222."""
    push = 0.2505859375
    scene = vx.Scene(
        vx.Elasticity(young=1000.0, poisson=0.3),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
        vx.Pressure(1.0, on="top"),
        vx.Traction(lambda x, t: (push * t, push * t / 2, 0.0), on="left"),
    )
    with pytest.raises((vx.SceneError, vx.SolverFailed, vx.NotCertified), match="the body"):
        vx.simulate(scene, vx.meshes.cubes(3), [0.0, 1.0], initial="settled")


@pytest.mark.filterwarnings(f"ignore:.*{ALONE}")
def test_a_refusal_names_the_forces_along_a_diagonal():
    """The force 0.5 pushes a cube of weight 1 with mu = 0.3."""
    scene = vx.Scene(
        vx.Elasticity(young=1000.0, poisson=0.3),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
        vx.BodyForce(lambda x, t: np.array([0.5**1.5 * t, 0.5**1.5 * t, -1.0])),
    )
    with pytest.raises(vx.SceneError, match=r"a force of 0\.5, and friction.* resists with at most 0\.3: 0\.2 is"):
        vx.simulate(scene, vx.meshes.cubes(2), [0.0, 1.0], initial="settled")


@pytest.mark.filterwarnings("ignore:supports.*nothing but friction:vemcvx.SceneWarning")
def test_a_sliding_motion_is_free_of_rounding():
    """Components of 1e-15 along contact normals are removed from the motion, but a slope of 1e-9 is kept."""
    unit = small("voronoi", 4)
    rails = vx.PrescribedDisplacement(lambda x, t: -1e-3 * t * np.ones(len(x)), on="top", direction="normal")
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), rails, vx.UnilateralContact(on=["left", "bottom"]))
    sides = {name: edges for name, edges in unit.boundaries.items() if name != "boundary"}

    def motion(scale, shift, lean=0.0):
        points = scale * unit.points @ np.array([[1.0, lean], [-lean, 1.0]]) + shift
        posed = pose_scene(scene, vx.PolygonMesh(points, unit.cells, boundaries=sides))
        (mode,) = posed.system.kernel.modes.T
        return (posed.supports.P @ mode).reshape(-1, 2)

    for place in ((1.0, (0.0, 0.0)), (240.0, (17.3, -5.1)), (0.7, (1e5, 3e4))):
        assert np.array_equal(np.abs(motion(*place)), np.tile([1.0, 0.0], (len(unit.points), 1)))
    inclined = motion(1.0, (0.0, 0.0), lean=1e-9)
    assert inclined[:, 1] / inclined[:, 0] == pytest.approx(1e-9, abs=1e-14)


@pytest.mark.filterwarnings(f"ignore:.*{ALONE}")
def test_equilibrium_starts_and_iterative_solvers_are_refused_on_a_kernel():
    with pytest.raises(vx.SceneError, match="^initial: 'equilibrium' is the state without friction"):
        vx.simulate(make_slab(1.0), vx.meshes.squares(2), TIMES, initial="equilibrium")
    with pytest.raises(vx.NotAccepted, match="^linear solver Iterative: the stiffness has a kernel"):
        vx.simulate(make_slab(1.0), vx.meshes.squares(2), TIMES, linear=vx.Iterative())


@pytest.mark.arithmetic
@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")
@mostly_long("condense", [True, False])
def test_a_settled_column_has_its_energy_to_twelve_digits(condense):
    """A uniform stress of 2 has the energy 2^2 / (2 E)."""
    walls, load = vx.Symmetry(on=["left", "right"]), vx.Traction((0.0, -2.0), on="top")
    scene = vx.Scene(vx.Elasticity(200.0, 0.0), walls, load, vx.UnilateralContact(on="bottom"))
    options = {"initial": "settled", "solver": vx.Newton(accuracy=1e-12), "condense": condense}
    history = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], **options)
    assert history.energy == pytest.approx([0.01, 0.01], rel=1e-12)
    assert history.certificate.max() < 1e-12
    assert vx.error_budget(history).space.max() < 1e-12


def test_displacements_of_nodes_need_one_column_per_motion():
    for wrong in (np.ones((3, 2)), np.ones(3)):
        with pytest.raises(vx.SceneError, match=r"Kernel: found moved of shape .* for 1 motions"):
            Kernel(np.ones((2, 1)), ("all",), moved=wrong)
