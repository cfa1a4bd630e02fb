"""Derivatives of random scenes equal central differences. Forward and adjoint sweeps agree.

The step of the central differences is 1e-4 times the parameter. The truncation error is about 1e-8 of the largest
derivative, and the accuracy 1e-12 of the runs adds about 1e-8. The comparison ends before the first step in which
active sets of the runs differ. Derivatives are multiplied by the parameters before the comparison.
"""

import warnings

import numpy as np
import pytest

import vemcvx as vx

ACCURATE = vx.Newton(accuracy=1e-12)
STEP = 1e-4
KINDS = "tresca", "coulomb", "discs", "compliance", "two bodies", "viscosity", "ground", "friction alone", "dashpots"


def draw(seed, kind):
    """Return `scene_of`, `theta`, `mesh`, `times` and names of quantities, for a random scene of a kind."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    times = np.append(0.0, np.sort(rng.uniform(0.1, 1.0, 6)))
    in_space = kind == "discs"
    if in_space:
        mesh = vx.meshes.cubes(2) if rng.random() < 0.5 else vx.meshes.tetrahedra(2)
    elif kind == "two bodies":
        low, top = (vx.meshes.squares((int(rng.integers(2, 5)), 2), box=((0, 1), (a, a + 0.5))) for a in (0.0, 0.5))
        mesh = vx.meshes.bodies({"low": low, "top": top})
    else:
        mesh = getattr(vx.meshes, rng.choice(["squares", "triangles", "voronoi"]))(int(rng.integers(3, 6)))
    theta = np.array([rng.uniform(50, 200), rng.uniform(0.1, 0.4), rng.uniform(0.1, 0.6), rng.uniform(0.5, 1.5)])
    pull, turn = rng.uniform(0.01, 0.03), rng.uniform(2.0, 6.0)
    of = ["energy", "reaction of top x", "reaction of top y"]
    if kind in ("viscosity", "dashpots"):
        of.append("displacement at (1, 0.5) x")
    else:
        of += ["dissipated", "displacement at (1, 0.5, 0.5) x" if in_space else "displacement at (0.7, 0.6) x"]

    def scene_of(theta):
        young, poisson, friction, size = theta

        def move(x, t):
            down = -0.01 * min(3.0 * t, 1.0)
            along = size * pull * np.sin(turn * t)
            return [along, 0.3 * along, down] if in_space else [along, down]

        body = vx.Elasticity(young, poisson)
        held = vx.PrescribedDisplacement(move, on="top")
        tresca = vx.TrescaFriction(friction * young * 0.01, on="bottom")
        if kind in ("tresca", "discs"):
            return vx.Scene(body, held, vx.BilateralContact(on="bottom"), tresca)
        if kind == "viscosity":
            viscous = vx.Viscosity(0.1 * young, 0.05 * young)
            return vx.Scene(body, viscous, held, vx.BilateralContact(on="bottom"), tresca)
        if kind == "ground":
            belt = vx.TrescaFriction(friction * young * 0.01, on="bottom", ground=lambda x, t: [-size * pull * t, 0.0])
            return vx.Scene(body, held, vx.BilateralContact(on="bottom"), belt)
        coulomb = vx.CoulombFriction(friction, on="bottom")
        if kind == "compliance":
            return vx.Scene(body, held, vx.NormalCompliance(2.0 * size * young, on="bottom"), coulomb)
        if kind == "dashpots":
            return vx.Scene(body, held, vx.VelocityContact(on="bottom", damping=0.3 * size * young), tresca)
        if kind == "two bodies":
            joint = "low|top"
            rubs = vx.UnilateralContact(on=joint), vx.CoulombFriction(friction, on=joint)
            return vx.Scene(body, vx.PrescribedDisplacement(move, on="top.top"), vx.Clamp(on="low.bottom"), *rubs)
        if kind == "friction alone":
            press = vx.Pressure(lambda x, t: 0.02 * young * min(3 * t, 1.0) + 0 * x[:, 0], on="top")
            push = vx.Traction(lambda x, t: [0.2 * friction * 0.02 * young * size * np.sin(turn * t), 0.0], on="right")
            return vx.Scene(body, press, push, vx.UnilateralContact(on="bottom"), coulomb)
        return vx.Scene(body, held, vx.UnilateralContact(on="bottom"), coulomb)

    if kind == "friction alone":
        of = ["energy", "dissipated"]
    if kind == "two bodies":
        of[1:3] = ["reaction of top.top x", "reaction of low.bottom y"]
    return scene_of, theta, mesh, times, of


def compare(seed, kind):
    """Check the derivatives of a random scene, and return the number of compared steps."""
    scene_of, theta, mesh, times, of = draw(seed, kind)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vx.SceneWarning)  # A body that friction alone holds causes a warning.
        found = vx.sensitivities(scene_of, theta, mesh, times, of, solver=ACCURATE)
        sets, quotients, same = active_sets(found), np.zeros(found.jacobian.shape), ~found.one_sided
        for j, e in enumerate(STEP * np.diag(theta)):
            more, less = (
                vx.sensitivities(scene_of, theta + way * e, mesh, times, of, solver=ACCURATE) for way in (1, -1)
            )
            quotients[..., j] = (more.values - less.values) / (2.0 * STEP)
            for other in (more, less):
                same &= (active_sets(other) == sets).all(axis=1)
    steps = int(np.argmin(np.append(same, False)))
    size = np.abs(quotients).max(axis=(1, 2), keepdims=True)
    # The regularisation of `vx.Newton` causes slips of about 1e-11 at sticking nodes.
    size = np.maximum(size, 1e-5 * np.abs(found.values).max())
    off = np.abs(found.jacobian * theta - quotients)[:, :steps]
    assert (off <= 1e-6 * size).all(), f"{kind}, seed {seed}: {(off / size).max():.1e}"
    weights = np.random.default_rng(seed).standard_normal(found.values.shape)
    terms = theta * np.einsum("qt,qtp->qtp", weights, found.jacobian)
    apart = np.abs(theta * found.gradient(weights) - terms.sum(axis=(0, 1)))
    assert (apart <= 1e-12 * np.abs(terms).sum(axis=(0, 1)).max()).all()
    return steps


def active_sets(found):
    """Return the stick and contact states of all steps in one array."""
    run = found.history.trajectory
    return np.hstack([run.sticking, run.pressures > 0])


@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_are_those_of_central_differences_and_the_adjoint_gives_the_same(kind):
    assert compare(0, kind) > 1


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_derivatives_of_two_hundred_scenes(kind):
    steps = [compare(seed, kind) for seed in range(1, 24)]
    assert sum(steps) > 4 * len(steps)


def test_a_settled_half_model_slips_in_its_first_step_like_the_whole_body():
    def scene_of(theta, *more):
        rough = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(theta[1], on="bottom")
        press = vx.PrescribedDisplacement([0.0, -0.02], on="top")
        return vx.Scene(vx.Elasticity(theta[0], 0.3), press, *rough, *more)

    half, whole, arguments = vx.meshes.squares(2), vx.meshes.squares((4, 2), box=((-1, 1), (0, 1))), ([0.0], ["energy"])
    rollers, theta, first = vx.Symmetry(on="left"), np.array([100.0, 0.1]), {"initial": "settled", "solver": ACCURATE}
    found = vx.sensitivities(lambda theta: scene_of(theta, rollers), theta, half, *arguments, **first)
    both = vx.sensitivities(scene_of, theta, whole, *arguments, **first)
    runs = (vx.simulate(scene_of([100.0, mu], rollers), half, [0.0], **first) for mu in (0.1001, 0.0999))
    more, less = (run.energy[0] for run in runs)
    assert np.isclose(found.jacobian[0, 0, 0], found.values[0, 0] / 100.0)
    assert np.isclose(found.jacobian[0, 0, 1], (more - less) / 2e-4, rtol=1e-6)
    assert np.allclose(2.0 * found.jacobian, both.jacobian)
    assert not found.one_sided.any()


def test_friction_on_dragged_nodes_turns_with_the_motion_of_their_support():
    def scene_of(theta):
        way = 0.01 * np.array([np.cos(theta[0]), np.sin(theta[0]), 0.0])
        held = vx.PrescribedDisplacement(lambda x, t: t * way, on="left")
        tresca = vx.TrescaFriction(0.5, on="bottom")
        return vx.Scene(vx.Elasticity(100.0, 0.3), held, vx.BilateralContact(on="bottom"), tresca)

    mesh, times, of = vx.meshes.cubes(1), [0.0, 1.0], ["reaction of left y"]
    more, less = (
        vx.simulate(scene_of([x]), mesh, times, solver=ACCURATE).reaction("left")[1, 1] for x in (0.6001, 0.5999)
    )
    found = vx.sensitivities(scene_of, [0.6], mesh, times, of, solver=ACCURATE)
    assert np.isclose(found.jacobian[0, 1, 0], (more - less) / 2e-4, rtol=1e-6)


def test_a_support_that_begins_to_drag_nodes_with_a_parameter_is_refused():
    def scene_of(theta):
        held = vx.PrescribedDisplacement(lambda x, t: [theta[0] * max(t - 1.0, 0.0) + 0.01 * min(t, 1.0), 0.0], "left")
        tresca = vx.TrescaFriction(0.5, on="bottom")
        return vx.Scene(vx.Elasticity(100.0, 0.3), held, vx.BilateralContact(on="bottom"), tresca)

    with pytest.raises(vx.SceneError, match=r"theta\[0\] moves, against friction, a support at rest in the run"):
        vx.sensitivities(scene_of, [0.0], vx.meshes.squares(2), [0.0, 1.0, 2.0], ["reaction of left x"])


def test_the_adjoint_sweep_takes_contact_without_friction():
    def scene_of(theta):
        held = vx.PrescribedDisplacement([0.0, -theta[0]], on="top")
        return vx.Scene(vx.Elasticity(100.0, 0.3), held, vx.UnilateralContact(on="bottom"))

    mesh, first = vx.meshes.squares(2), {"initial": "settled"}
    found = vx.sensitivities(scene_of, [0.01], mesh, [0.0], ["energy"], **first)
    assert np.isclose(found.gradient([[1.0]])[0], 2.0 * found.values[0, 0] / 0.01)
