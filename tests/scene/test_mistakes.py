"""A user's mistakes: each error is one sentence. effects/test_refusals.py and whole/messages.txt have more."""

import re

import numpy as np
import pytest

import vemcvx as vx

MESH = vx.meshes.squares(3)
TIMES = [0.0, 0.5, 1.0]


def pull(x, t):
    return np.tile([t, 0.0], (len(x), 1))


PARTS = {
    "material": vx.Elasticity(young=200.0, poisson=0.3),
    "clamp": vx.Clamp(on="right"),
    "load": vx.Traction(pull, on="left"),
    "contact": vx.BilateralContact(on="bottom"),
    "friction": vx.TrescaFriction(bound=4.0, on="bottom"),
}


def scene(**instead):
    """Return a correct scene in which `instead` replaces parts."""
    return vx.Scene(*(part for part in (PARTS | instead).values() if part is not None))


def run(mesh=MESH, times=TIMES, of=None, **changes):
    """Simulate a scene; keywords unknown to `simulate` replace parts of the scene."""
    options = {k: changes.pop(k) for k in ("solver", "initial", "store", "linear", "progress") if k in changes}
    return vx.simulate(of or scene(**changes), mesh, times, **options)


def hinged():
    """Return two squares that share one node."""
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [2, 1], [2, 2], [1, 2]]
    mesh = vx.PolygonMesh(np.array(points, dtype=float), [[0, 1, 2, 3], [2, 4, 5, 6]])
    return mesh.with_boundary("low", lambda x: x[:, 1] < 0.1)


def apart():
    """Return two squares that share no node."""
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [3, 0], [4, 0], [4, 1], [3, 1]]
    mesh = vx.PolygonMesh(np.array(points, dtype=float), [[0, 1, 2, 3], [4, 5, 6, 7]], boundaries={})
    return mesh.with_boundary("first", lambda x: x[:, 0] < 0.1)


def move(value, on, direction=None):
    return vx.PrescribedDisplacement(value, on=on, direction=direction)


def along(sign):
    return lambda x, t: [sign * t, 0.0]


SYMMETRIC = [[2.0, -1.0], [-1.0, 2.0]]
NOTHING = "neither a support nor friction(:|; the first is)"
NAN_LATER = vx.Traction(lambda x, t: np.where(t > 0.6, np.nan, 0.0) + 0 * x, "left")
NAN_STATE = np.where(np.arange(32).reshape(16, 2) == 11, np.nan, 0.0)


def loaded(force):
    return run(load=vx.Traction(force, "left"))


def made_of(*constants, **options):
    return run(material=vx.Elasticity(*constants, **options))


def held(value, direction=None):
    return run(clamp=move(value, "right", direction))


def on(mesh, support):
    return run(mesh=mesh, of=vx.Scene(PARTS["material"], vx.Clamp(support)))


def marched(load, norms=None, K=SYMMETRIC, **options):
    return vx.march(vx.System(K, load, norms), TIMES, **options)


def growing(t):
    return [t, t]


def a_point_at_a_time(x, t):
    return (1.0, 0.0) if x[0] > 0 else (0.0, 0.0)


CASES = {
    "friction alone": (lambda: run(clamp=None, contact=None), f"supports: .* 2 rigid motions meet {NOTHING} "),
    "rollers alone": (lambda: run(clamp=None, friction=None), rf"supports: .* 1 .* meets {NOTHING} the translation"),
    "a second part": (lambda: on(apart(), "first"), f"supports: part 2 of 2 of the body floats: 3 .* {NOTHING} "),
    "a hinge": (lambda: on(hinged(), "low"), rf"supports: .* {NOTHING} a motion of .* about hinges, such as node 2"),
    "NaN later": (lambda: run(load=NAN_LATER), "Traction on left: found NaN or infinity in 12 of 12 .* and t = 1"),
    "a point at a time": (lambda: loaded(a_point_at_a_time), "Traction on left: its function failed .*ambiguous"),
    "f(x, t) for a modulus": (lambda: made_of(lambda x, t: 200.0, 0.3), r"Elasticity: young: .* called as f\(x\)"),
    "young": (lambda: made_of(lambda x: 0.5 - x[:, 0] - 0.1 * x[:, 1], 0.3), r"Elasticity: .*young = -0\.41.* cell 8"),
    "a state with NaN": (lambda: run(initial=NAN_STATE), "initial: found NaN or infinite values"),
    "off its supports": (lambda: run(initial=np.ones((16, 2))), r"initial: .* node 0 .* contradicts its supports"),
    "more than friction holds": (
        lambda: loaded((50.0, 0.0)),
        r"initial: the state at t = 0 is not held by friction .* moves it by 9\.7e-01 .* slips most at node \d+",
    ),
    "a state of a system": (lambda: marched(growing, initial=[1, 2, 3]), r"initial: found .* \(3,\); wanted 2 finite"),
    "against each other": (
        lambda: run(clamp=None, other=move(along(1), "top"), another=move(along(-1), "left"), load=None),
        r"PrescribedDisplacement on top: node 12 at \[0\. 1\.\] is to move by 0\.5 along \[1\. 0\.\] at t = 0\.5",
    ),
    "against a clamp": (lambda: run(other=move(along(1), "top")), r"PrescribedDisplacement on top: node 15 .* move it"),
    "a step beyond the end": (lambda: run(store=np.array([1, 3])), r"store: found array\(\[1, 3\]\)"),
    "K singular": (lambda: marched(lambda t: [0, 0], K=[[1.0, -1.0], [-1.0, 1.0]]), "the stiffness matrix is singular"),
}  # fmt: skip


@pytest.mark.parametrize(("mistake", "says"), CASES.values(), ids=CASES)
def test_a_mistake_gives_one_clear_sentence(mistake, says):
    with pytest.raises(vx.SceneError) as caught:
        mistake()
    words = str(caught.value)
    assert re.search(f"^{says}", words), words
    assert "\n" not in words
    assert words.endswith(".")
    assert len(words) < 500


def test_the_scene_without_a_mistake_runs():
    """Each case above differs from this scene, or this system, by one mistake."""
    assert run().certificate.max() < 1e-8
    assert vx.march(vx.System(SYMMETRIC, lambda t: [t, t], vx.Norms(np.eye(2), 0.3)), TIMES).certificate.max() < 1e-8


SOLVERS = {
    "unknown": (vx.ThroughCvxpy("FOO"), "solver 'FOO': cvxpy does not find it here; it finds .*CLARABEL"),
    "an option": (vx.Clarabel(options={"speed": 9}), "solver Clarabel: refused the options {'speed': 9}"),
}


@pytest.mark.parametrize("name", SOLVERS)
def test_a_solver_that_refuses_is_named(name):
    solver, says = SOLVERS[name]
    with pytest.raises(vx.NotAccepted, match=f"^{says}"):
        run(solver=solver)


def test_friction_without_contact_causes_a_warning():
    """The most likely mistake: nothing presses the body against the boundary with friction."""
    with pytest.warns(vx.SceneWarning, match="^TrescaFriction on bottom: at 3 of 4 places nothing holds the body"):
        run(contact=None)
