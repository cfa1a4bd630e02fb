"""Bodies that nothing but friction holds: K has a kernel, and errors are measured in its seminorm."""

import numpy as np
import pytest
from scenes import few_families, mostly_long, small

import vemcvx as vx
from vemcvx.program import Kernel, Operators, StepProgram
from vemcvx.scene import pose_scene

TIMES = np.linspace(0.0, 1.0, 9)
BOUND = 4.0
ALONE = "nothing but friction or one-sided contact holds the body against the translation"


def slab(pull, course=np.sin, bound=BOUND):
    """A block on a rough floor, pulled at its left side with `pull` over one unit of length, and nothing else."""

    return vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Traction(lambda x, t: np.column_stack([np.full(len(x), pull * course(t)), np.zeros(len(x))]), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, on="bottom"),
    )


def sides(mesh):
    return {name: edges for name, edges in mesh.boundaries.items() if name != "boundary"}


def swing(t):
    return np.sin(2 * np.pi * t)


@few_families
@mostly_long("condense", [True, False])
@mostly_long("share", [0.1, 0.97], 1)
def test_friction_alone_holds_the_body(family, share, condense):
    """The reaction is the load, every step certified in the seminorm, and non-uniqueness is said."""
    mesh = small(family, 6)
    with pytest.warns(vx.SceneWarning, match=ALONE):
        history = vx.simulate(slab(share * BOUND, swing), mesh, TIMES, condense=condense)
    assert history.certificate.max() <= 1e-8
    load = share * BOUND * swing(TIMES)
    assert np.abs(history.force("bottom")[:, 0] + load).max() < 1e-9 * BOUND
    gain = history.work - (history.energy - history.energy[0]) - history.dissipated
    assert (np.diff(gain) > -1e-12 * history.work.max()).all()


@pytest.mark.filterwarnings("ignore:.*nothing but friction or one-sided contact")
@mostly_long("solver", [vx.Clarabel(), vx.OSQP()], ids=lambda s: s.name)
def test_unknowns_that_anchors_alone_hold_keep_their_scale(solver):
    """Two nodes touch, which only stretch against each other: rounding is all that K has of the rest of them."""
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Pressure(lambda x, t: t, on="top"),
        vx.Traction(lambda x, t: [0.3 * t, 0.0], on="left"),
        vx.NormalCompliance(1e3, on="bottom"),
        vx.TrescaFriction(1.0, on="bottom"),
    )
    history = vx.simulate(scene, vx.meshes.squares(1), [0.0, 0.5, 1.0], solver=solver)
    assert history.certificate.max() <= 1e-6
    assert history.force("bottom")[-1] == pytest.approx([-0.3, 1.0], abs=1e-9)


def test_too_much_load_is_refused_with_the_force_that_is_lacking():
    says = r"^step 8 at t = 1: .* the translation \(1, 0\) of the body.* force of 4\.2, .* at most 4: 0\.2"
    with pytest.warns(vx.SceneWarning, match=ALONE), pytest.raises(vx.SceneError, match=says):
        vx.simulate(slab(4.2, lambda t: t), vx.meshes.squares(4), TIMES)


def test_a_sliding_chain_by_hand():
    """Two blocks of bounds 1 and 2, joined by a spring 10: pulled at the first, it stretches by (load - 1) / 10."""
    K = 10.0 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    kernel = Kernel(np.ones((2, 1)), ("sliding together",))
    system = vx.System(K, lambda t: [2.5 * t, 0.0], vx.Norms(np.eye(2), [1.0, 2.0]), kernel=kernel)
    result = vx.march(system, np.linspace(0, 1, 6))
    dirichlet_force = result.state[:, 0] - result.state[:, 1]
    assert dirichlet_force == pytest.approx(np.maximum(2.5 * result.times - 1.0, 0.0) / 10, abs=1e-9)
    assert np.abs(result.state[:, 1]).max() < 1e-9
    assert result.certificate.max() < 1e-8
    # Every step dissipates what the first block's friction does on its slip.
    assert result.dissipated[-1] == pytest.approx(result.state[-1, 0], rel=1e-9)
    assert result.multipliers[-1, :, 0].sum() == pytest.approx(2.5, rel=1e-12)


@pytest.mark.long
@few_families
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@mostly_long("condense", [True, False])
def test_a_body_that_slides_along_a_soft_floor_is_said_to(family, condense):
    """Pulled harder than its friction holds: that sliding does not press into the floor is known but for rounding."""
    scene = vx.Scene(
        vx.Elasticity(2.0, 0.3),
        vx.Symmetry(on="top"),
        vx.NormalCompliance(3.0, on="bottom"),
        vx.TrescaFriction(0.1, on="bottom"),
        vx.Traction(lambda x, t: [0.3 * t, 0.0], on="left"),
    )
    with pytest.raises(vx.SceneError, match=r"against the translation \(1, 0\) .* there is no equilibrium"):
        vx.simulate(scene, small(family, 3), [0.0, 0.2, 1.0], condense=condense)


@pytest.mark.arithmetic
@mostly_long("far", [1.0, 1e2, 1e3, 1e4, 1e5, 1e8], 1, 5)
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()], ids=lambda s: s.name)
def test_a_body_is_carried_as_far_as_it_is_taken(far, solver):
    """Two nodes joined by a spring 1; a carriage on a spring 1 pulls the first by friction 1, .5 holds the second."""
    K = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    body = Kernel(np.array([[1.0], [1.0], [0.0]]), ("the translation",))
    terms = vx.Norms(np.array([[1.0, 0.0, -1.0], [0.0, 1.0, 0.0]]), np.array([1.0, 0.5]))
    run = vx.march(vx.System(K, lambda t: np.array([0.0, 0.0, far * t]), terms, kernel=body), [0.0, 1.0], solver=solver)
    # The carriage is held back by what holds the body; friction carries the first node, the second rubs.
    wanted = np.array([far - 0.5, far - 1.0, far - 0.5]) if far > 1.0 else np.array([0.5, 0.0, 0.5])
    allowed = run.certificate[-1] * run.norm[-1] + 1e-12 * far
    assert np.sqrt((K @ (run.state[-1] - wanted)) @ (run.state[-1] - wanted)) <= allowed
    assert np.abs(run.multipliers[-1].ravel() - [-0.5, 0.5]).max() <= allowed


@pytest.mark.long
@few_families
@pytest.mark.parametrize("angle", [0.0, 0.3, 0.7, 1.1])
@pytest.mark.parametrize("limit", [vx.UnilateralContact, vx.NormalCompliance])
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
def test_ground_moves_under_a_body_between_rollers(family, angle, limit):
    """Friction feels no motion of the body without strain, but for rounding, and what it does is that of any angle."""
    c, s = np.cos(angle), np.sin(angle)
    turn, energies = np.array([[c, -s], [s, c]]), []
    for rotation in (np.eye(2), turn):
        plain = small(family, 4)
        mesh = vx.PolygonMesh(plain.points @ rotation.T, plain.cells, boundaries=sides(plain))
        floor = {"stiffness": 300.0} if limit is vx.NormalCompliance else {}
        scene = vx.Scene(
            vx.Elasticity(100.0, 0.3),
            vx.Symmetry(on="left"),
            limit(**floor, on="bottom"),
            vx.TrescaFriction(0.3, on="bottom", ground=lambda x, t, R=rotation: tuple(R @ (0.01 * t, 0.0))),
            vx.Pressure(0.5, on="top"),
        )
        history = vx.simulate(scene, mesh, [0.0, 0.5, 1.0], initial="settled")
        assert history.certificate.max() <= 1e-8
        energies.append(history.energy)
    assert np.abs(energies[1] - energies[0]).max() <= 1e-7 * energies[0].max()


@pytest.mark.long
@pytest.mark.filterwarnings(f"ignore:.*{ALONE}")
@pytest.mark.parametrize("beyond", [1e-10, 1e-9, 1e-8, 1e-3])
@pytest.mark.parametrize("tips", [False, True])
def test_loads_just_beyond_the_limit_are_refused(beyond, tips):
    """A block under the weight 1, pushed with .3 where it slides with .3; with 1 where it tips about its toe with 1."""
    push = (1.0 if tips else 0.3) * (1 + beyond)
    friction = vx.TrescaFriction(bound=5.0, on="bottom") if tips else vx.CoulombFriction(0.3, on="bottom")
    sides = ["left"] if tips else ["left", "right"]

    scene = vx.Scene(
        vx.Elasticity(young=1000.0, poisson=0.3),
        vx.UnilateralContact(on="bottom"),
        friction,
        vx.Traction((0.0, -1.0), on="top"),
        vx.Traction(lambda x, t: [push * t / len(sides), 0.0], on=sides),
    )
    # Nearer than 1e-9 of the load the motion is not told from zero, and the step is refused as not certified.
    named = "" if beyond <= 1e-9 else ".* there is no equilibrium"
    refused = (vx.SceneError, vx.NotCertified) if beyond <= 1e-9 else vx.SceneError
    with pytest.raises(refused, match=f"^step 2 at t = 1: {named}"):
        vx.simulate(scene, vx.meshes.squares(5), [0.0, 0.5, 1.0], initial="settled")


@pytest.mark.parametrize(
    ("modes", "norms", "message"),
    [
        ([[1.0], [2.0]], vx.Norms(np.eye(2), 1.0), "the motion sliding is not in the kernel"),
        ([[1.0], [1.0]], None, r"a motion of K's kernel \(sliding\) moves no norm term"),
        (
            [[1.0], [1.0]],
            vx.Norms(np.array([[1.0, 2.0**-53 - 1.0]]), 1.0),  # by the rounding of one
            r"a motion of K's kernel \(sliding\) moves no norm term",
        ),
        ([[1.0], [1.0], [1.0]], vx.Norms(np.eye(2), 1.0), "wanted one column of 2 numbers per motion"),
    ],
)
def test_kernels_that_are_none(modes, norms, message):
    with pytest.raises(vx.SceneError, match=f"^System: .*{message}"):
        vx.System([[1.0, -1.0], [-1.0, 1.0]], lambda t: [t, 0.0], norms, kernel=Kernel(np.array(modes), ("sliding",)))


def floating(grip, stop, push, w):
    """The program of a body without stiffness: all that it can do is the motions that norm terms and limits feel."""
    m, block, modes = grip.shape
    every = {"kernel": np.eye(modes), "anchor": np.ones(modes)}
    operators = Operators(np.zeros((modes, modes)), grip.reshape(-1, modes), block, D=stop, **every)
    return StepProgram(operators, push, w, np.zeros(m * block), np.zeros(len(stop)))


@pytest.mark.long
@pytest.mark.parametrize("block", [1, 2])
@pytest.mark.parametrize("modes", [1, 3, 6])
def test_loads_just_beyond_what_holds_are_told_from_those_just_below(block, modes):
    """On a motion c the strongest load is that of lam_i = w_i G_i c / |G_i c|, and of what presses along c."""
    rng = np.random.default_rng(block + 10 * modes)
    beyond = 1e-8 if block == 1 else 1e-7
    for _ in range(20):
        grip, w, c = rng.normal(size=(12, block, modes)), rng.uniform(0.1, 1.0, 12), rng.normal(size=modes)
        stop = rng.normal(size=(4, modes))
        stop[:2] -= np.outer(stop[:2] @ c, c) / (c @ c)
        stop[2:] *= -np.sign(stop[2:] @ c)[:, None]
        stop = stop if modes > 1 else stop[2:]
        slip = grip @ c
        strongest = np.einsum("ijk,ij->k", grip, w[:, None] * slip / np.linalg.norm(slip, axis=1)[:, None])
        push = strongest + (stop[:2].T @ rng.uniform(0, 1, 2) if modes > 1 else 0.0)
        assert floating(grip, stop, (1 - beyond) * push, w).find_unbalanced_motion() is None
        motion = floating(grip, stop, push + beyond * strongest, w).find_unbalanced_motion()
        assert motion @ (push + beyond * strongest) > w @ np.linalg.norm(grip @ motion, axis=1)


@few_families
@pytest.mark.filterwarnings("ignore:supports.*nothing but friction:vemcvx.SceneWarning")
def test_a_body_slides_along_one_axis_to_the_last_digit(family):
    """What rounding leaves across, 1e-15, would press against contact; rails at 1e-9 to the axis are no rounding."""
    unit = small(family, 4)
    rails = vx.PrescribedDisplacement(lambda x, t: -1e-3 * t * np.ones(len(x)), on="top", direction="normal")
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), rails, vx.UnilateralContact(on=["left", "bottom"]))

    def motion(scale, shift, lean=0.0):
        points = scale * unit.points @ np.array([[1.0, lean], [-lean, 1.0]]) + shift
        posed = pose_scene(scene, vx.PolygonMesh(points, unit.cells, boundaries=sides(unit)))
        (mode,) = posed.system.kernel.modes.T
        return (posed.supports.P @ mode).reshape(-1, 2)

    for given in ((1.0, (0.0, 0.0)), (1e3, (0.0, 0.0)), (240.0, (17.3, -5.1)), (0.7, (1e5, 3e4))):
        assert np.array_equal(np.abs(motion(*given)), np.tile([1.0, 0.0], (len(unit.points), 1)))
    inclined = motion(1.0, (0.0, 0.0), lean=1e-9)
    assert inclined[:, 1] / inclined[:, 0] == pytest.approx(1e-9, abs=1e-14)


@pytest.mark.filterwarnings(f"ignore:.*{ALONE}")
def test_what_takes_no_kernel_is_refused():
    """An equilibrium without friction, and iterative solvers; settled, the floor bears the load."""
    with pytest.raises(vx.SceneError, match="^initial: 'equilibrium' is without friction"):
        vx.simulate(slab(1.0), vx.meshes.squares(2), TIMES, initial="equilibrium")
    with pytest.raises(vx.NotAccepted, match="^linear solver Iterative: the stiffness has a kernel"):
        vx.simulate(slab(1.0), vx.meshes.squares(2), TIMES, linear=vx.Iterative())
    settled = vx.simulate(slab(1.0, lambda t: 1.0 + t), vx.meshes.squares(2), TIMES, initial="settled")
    assert settled.force("bottom")[0, 0] == pytest.approx(-1.0, rel=1e-9)


@pytest.mark.arithmetic
@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")
@mostly_long("condense", [True, False])
def test_a_column_that_nothing_clamps_is_answered_to_twelve_digits(condense):
    """Settled, then left alone: a uniform stress of 2 has the energy 2^2 / 2E, and no error of the mesh."""
    walls, load = vx.Symmetry(on=["left", "right"]), vx.Traction((0.0, -2.0), on="top")
    scene = vx.Scene(vx.Elasticity(200.0, 0.0), walls, load, vx.UnilateralContact(on="bottom"))
    options = {"initial": "settled", "solver": vx.Newton(accuracy=1e-12), "condense": condense}
    history = vx.simulate(scene, vx.meshes.squares(4), [0.0, 1.0], **options)
    assert history.energy == pytest.approx([0.01, 0.01], rel=1e-12)
    assert history.certificate.max() < 1e-12
    assert vx.error_budget(history).space.max() < 1e-12
