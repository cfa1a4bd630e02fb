"""A user's mistakes, each refused in one sentence; effects that cannot be are in tests/effects/test_refusals.py."""

import re
from dataclasses import dataclass

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.effects import Contribution, Support

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
    """A scene that is in order, but for what stands `instead` of its parts."""
    return vx.Scene(*(part for part in (PARTS | instead).values() if part is not None))


def run(mesh=MESH, times=TIMES, of=None, **changes):
    """Simulate; keywords of `simulate` go there, others replace parts of the scene."""
    options = {k: changes.pop(k) for k in ("solver", "initial", "store", "linear", "progress") if k in changes}
    return vx.simulate(of or scene(**changes), mesh, times, **options)


@dataclass(frozen=True)
class Pin(vx.Effect):
    """Hold one node: what the boundary, made of edges, cannot name."""

    node: int

    def contribute(self, space):
        nodes = np.array([self.node, self.node])
        return Contribution(supports=(Support("Pin", nodes, np.eye(2), space.mesh.points[nodes]),))

    def describe(self):
        return f"Pin: node {self.node}"


def hinged():
    """Two squares that share one node."""
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [2, 1], [2, 2], [1, 2]]
    mesh = vx.PolygonMesh(np.array(points, dtype=float), [[0, 1, 2, 3], [2, 4, 5, 6]])
    return mesh.with_boundary("low", lambda x: x[:, 1] < 0.1)


def apart():
    """Two squares that share nothing."""
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [3, 0], [4, 0], [4, 1], [3, 1]]
    mesh = vx.PolygonMesh(np.array(points, dtype=float), [[0, 1, 2, 3], [4, 5, 6, 7]], boundaries={})
    return mesh.with_boundary("first", lambda x: x[:, 0] < 0.1)


def move(value, on, direction=None):
    return vx.PrescribedDisplacement(value, on=on, direction=direction)


def along(sign):
    return lambda x, t: [sign * t, 0.0]


SYMMETRIC = [[2.0, -1.0], [-1.0, 2.0]]
EXIST = r"this mesh has 'left', 'right', 'bottom', 'top', 'boundary'"
NOTHING = "neither a support nor friction(:|; the first is)"
NAN_LATER = vx.Traction(lambda x, t: np.where(t > 0.6, np.nan, 0.0) + 0 * x, "left")
FREE = {"contact": None, "friction": None}
NAN_STATE = np.where(np.arange(32).reshape(16, 2) == 11, np.nan, 0.0)
CELL_4 = np.where(np.arange(9) == 4, 0.7, 0.3)
LAST, INDEFINITE = vx.Norms(np.eye(3)[2:], 1.0), [[1.0, 2, 0], [2, 1, 0], [0, 0, 1]]


def loaded(force):
    return run(load=vx.Traction(force, "left"))


def made_of(*constants, **options):
    return run(material=vx.Elasticity(*constants, **options))


def rubbed(*settings, **options):
    return run(friction=vx.TrescaFriction(*settings, **options))


def held(value, direction=None):
    return run(clamp=move(value, "right", direction))


def on(mesh, support):
    return run(mesh=mesh, of=vx.Scene(PARTS["material"], vx.Clamp(support)))


def marched(load, norms=None, K=SYMMETRIC, **options):
    return vx.march(vx.System(K, load, norms), TIMES, **options)


def growing(t):
    return [t, t]


def three(t):
    return [t, t, t]


def a_point_at_a_time(x, t):
    return (1.0, 0.0) if x[0] > 0 else (0.0, 0.0)


CASES = {
    "a boundary": (lambda: run(clamp=vx.Clamp("rihgt")), rf"Clamp: there is no boundary named 'rihgt'; {EXIST}; add"),
    "no boundary": (lambda: run(clamp=vx.Clamp([])), f"Clamp: on= names no boundary; {EXIST}"),
    "of a reaction": (lambda: run().reaction("botom"), f"reaction: there is no boundary named 'botom'; {EXIST}"),
    "no material": (lambda: run(material=None), "Scene: found 0 materials"),
    "two materials": (lambda: run(other=PARTS["material"]), "materials: .* 9 have more than one .first: cell 0"),
    "a class": (lambda: scene(clamp=vx.Clamp), "Scene: found <class .*Clamp'>"),
    "effects in a list": (lambda: vx.Scene(list(PARTS.values())), r"Scene: found \[Elasticity"),
    "effects for a scene": (lambda: run(of=list(PARTS.values())), r"simulate: .*Elasticity.*\] instead of a scene"),
    "mesh and scene swapped": (lambda: vx.simulate(MESH, scene(), TIMES), "simulate: found PolygonMesh.* instead of a"),
    "a mesh's name": (lambda: run(mesh="squares"), "simulate: found 'squares' instead of a mesh"),
    "another mesh": (lambda: run(mesh=apart()), "BilateralContact: .*'bottom'; this mesh has 'first', 'boundary'"),
    "no supports": (lambda: run(clamp=None, **FREE), "supports: nothing holds the body, and its loads do"),
    "friction alone": (lambda: run(clamp=None, contact=None), f"supports: .* 2 rigid motions meet {NOTHING} "),
    "rollers alone": (lambda: run(clamp=None, friction=None), rf"supports: .* 1 .* meets {NOTHING} the translation"),
    # The edge at x = 1 turns about its far point along (1, 1): a translation with a rotation, or one across (1, 1).
    "oblique": (lambda: run(clamp=move(0.0, "right", (1, 1)), **FREE), f"supports: .* 1 .* {NOTHING} the translation"),
    "a corner": (lambda: run(clamp=Pin(0), **FREE), f"supports: .* 1 .* meets {NOTHING} .* with a rotation"),
    "a second part": (lambda: on(apart(), "first"), f"supports: part 2 of 2 of the body floats: 3 .* {NOTHING} "),
    "a hinge": (lambda: on(hinged(), "low"), rf"supports: .* {NOTHING} a motion of .* about hinges, such as node 2"),
    "a bound below zero": (lambda: rubbed(-1.0, "bottom"), r"TrescaFriction on bottom: found bound = -1 at \[0\."),
    "a bound below zero there": (
        lambda: rubbed(lambda x, t: 0.5 - t * x[:, 0], "bottom", quadrature="integral"),
        r"TrescaFriction on bottom: found bound = -0\.47.* at \[0\.97\d* 0\. *\] and t = 1",
    ),
    "a quadrature": (lambda: rubbed(1.0, "bottom", quadrature="foo"), "TrescaFriction .*quadrature 'foo'"),
    "NaN later": (lambda: run(load=NAN_LATER), "Traction on left: found NaN or infinity in 12 of 12 .* and t = 1"),
    "no t": (lambda: loaded(lambda x: x), r"Traction on left: .*called as f\(x, t\) with x of shape \(6, 2\):"),
    "a point at a time": (lambda: loaded(a_point_at_a_time), "Traction on left: its function failed .*ambiguous"),
    "three components": (lambda: loaded((1, 2, 3)), r"Traction on left: found .* \(3,\); wanted 2 components"),
    "components first": (lambda: loaded(lambda x, t: x.T), r"Traction on left: found .* \(2, 6\); wanted 2"),
    "scalars": (lambda: loaded(lambda x, t: x[:, 0]), r"Traction on left: found .* \(6,\); wanted 2"),
    "f(x, t) for a modulus": (lambda: made_of(lambda x, t: 200.0, 0.3), r"Elasticity: young: .* called as f\(x\)"),
    "incompressible": (lambda: made_of(1.0, 0.5), r"Elasticity: found poisson = 0\.5 in cell 0"),
    "poisson": (lambda: made_of(1.0, CELL_4, plane="stress"), r"Elasticity: found poisson = 0\.7 in cell 4"),
    "young": (lambda: made_of(lambda x: 0.5 - x[:, 0] - 0.1 * x[:, 1], 0.3), r"Elasticity: .*young = -0\.41.* cell 8"),
    "moduli of another mesh": (lambda: made_of(np.ones(4), 0.3), r"Elasticity: young: found .* \(4,\)"),
    "a plane": (lambda: made_of(1.0, 0.3, plane="foo"), "Elasticity: found plane 'foo'"),
    "a stabilisation": (lambda: made_of(1.0, 0.3, stabilisation="foo"), "Elasticity: found stabilisation 'foo'"),
    "decreasing times": (lambda: run(times=[0, 1, 0.5]), r"times: instant 2 is 0\.5"),
    "a state": (lambda: run(initial=np.zeros(3)), r"initial: found .* \(3,\); wanted .* \(16, 2\)"),
    "a state as a function": (lambda: run(initial=lambda x, t: 0.0 * x), "initial: found <function"),
    "a state with NaN": (lambda: run(initial=NAN_STATE), "initial: found NaN or infinite values"),
    "a state's name": (lambda: run(initial="settle"), r"initial: found 'settle'"),
    "off its supports": (lambda: run(initial=np.ones((16, 2))), r"initial: .* node 0 .* contradicts its supports"),
    "supports that have moved": (lambda: held((0.25, 0.0)), r"initial: .* contradicts its supports at t = 0, by"),
    "more than friction holds": (
        lambda: loaded((50.0, 0.0)),
        r"initial: the state at t = 0 is not held by friction .* moves it by 9\.7e-01 .* slips most at node \d+",
    ),
    "a load from the start": (
        lambda: run(load=vx.Traction((50.0, 0.0), "left"), friction=None),
        r"initial: the state at t = 0 is not in equilibrium .* use initial='settled'",
    ),
    "a state of a system": (lambda: marched(growing, initial=[1, 2, 3]), r"initial: found .* \(3,\); wanted 2 finite"),
    "against each other": (
        lambda: run(clamp=None, other=move(along(1), "top"), another=move(along(-1), "left"), load=None),
        r"PrescribedDisplacement on top: node 12 at \[0\. 1\.\] is to move by 0\.5 along \[1\. 0\.\] at t = 0\.5",
    ),
    "against a clamp": (lambda: run(other=move(along(1), "top")), r"PrescribedDisplacement on top: node 15 .* move it"),
    "an oblique one against a clamp": (
        lambda: run(other=move(lambda x, t: -t * np.ones(len(x)), "top", (3, 4))),
        r"PrescribedDisplacement on top: node 15 .* by -0\.5 along \[0\.6 0\.8\] at t = 0\.5",
    ),
    "no direction": (lambda: held(0.0, (0, 0)), r"PrescribedDisplacement on right: found direction \(0, 0\)"),
    "a direction in space": (lambda: held(0.0, (1, 0, 0)), r"PrescribedDisplacement .*\(1, 0, 0\); wanted .* 2 finite"),
    "an unknown direction": (lambda: held(0.0, "foo"), "PrescribedDisplacement .*direction: found 'foo', .*'normal',"),
    "a vector for a component": (lambda: held((0.0, 0.0), "normal"), r"PrescribedDisplacement on right: found .*"),
    "a number for a vector": (lambda: held(0.0), "PrescribedDisplacement on right: found the single number 0"),
    "a step beyond the end": (lambda: run(store=np.array([1, 3])), r"store: found array\(\[1, 3\]\)"),
    "a step not stored": (lambda: run(store="last").stress(1), r"history: step 1 was not stored; stored are \[2\]"),
    "a solver's class": (lambda: run(solver=vx.Newton), "solver: found <class .*Newton'>"),
    "K of one axis": (lambda: vx.System(np.ones(3), pull), r"System: K: found .* \(3,\)"),
    "K not square": (lambda: vx.System(np.ones((2, 3)), pull), r"System: K: found a matrix of shape \(2, 3\)"),
    "K not symmetric": (lambda: vx.System([[2.0, 1.0], [0.0, 2.0]], pull), r"System: K: row \d differs from column"),
    "K not positive": (lambda: vx.System(np.diag([1.0, -1.0]), pull), r"System: found K\[1, 1\] = -1"),
    "K singular": (lambda: marched(lambda t: [0, 0], K=[[1.0, -1.0], [-1.0, 1.0]]), "the stiffness matrix is singular"),
    "K indefinite": (lambda: marched(three, LAST, INDEFINITE), "the stiffness matrix is singular or indefinite"),
    "a constant load": (lambda: vx.System(SYMMETRIC, np.ones(2)), "System: found load = array"),
    "a load without t": (lambda: marched(lambda: 0), r"System: load: its function failed when called as f\(t\)"),
    "a load of three": (lambda: marched(three), r"System: load\(0\): found .* \(3,\); wanted \(2,\)"),
    "blocks": (lambda: vx.Norms(np.eye(3), 1.0, block=2), "Norms: found B with 3 rows and block = 2"),
    "a weight below zero": (lambda: vx.Norms(np.eye(2), [1.0, -3.0]), "Norms: found the weight -3 of norm term 1"),
    "a weight later": (lambda: marched(growing, vx.Norms(np.eye(2), lambda t: 0.7 - t)), r"Norms: .*weight -0\.3"),
    "three weights": (lambda: vx.Norms(np.eye(2), [1.0, 2.0, 3.0]), r"Norms: w: found .* \(3,\)"),
    "weights without t": (lambda: marched(growing, vx.Norms(np.eye(2), lambda: 1)), "Norms: w: its function failed"),
    "columns": (lambda: vx.System(SYMMETRIC, pull, vx.Norms(np.eye(3), 1.0)), "System: found norms over 3 unknowns,"),
    "norms": (lambda: vx.System(SYMMETRIC, pull, np.eye(2)), r"System: found norms = array.*; wanted Norms"),
    "an order": (lambda: vx.System(SYMMETRIC, pull, order=np.array([0, 0])), r"System: found order = array\(\[0,"),
    "e of one": (lambda: vx.Limits(np.eye(2), [1.0]), r"Limits: e: found an array of shape \(1,\)"),
    "e NaN": (lambda: vx.Limits(np.eye(2), [1.0, np.nan]), "Limits: e: found NaN"),
    "e without end below": (lambda: vx.Limits(np.eye(2), [1.0, -np.inf]), "Limits: e: found NaN or infinite"),
    "compliance": (lambda: vx.Limits(np.eye(2), 0.0, compliance=-1.0), "Limits: found the compliance -1 of limit 0"),
    "D": (lambda: vx.System(np.eye(3), pull, limits=vx.Limits(np.eye(2), 0.0)), "System: found limits over 2"),
    "limits": (lambda: vx.System(np.eye(2), pull, limits=5), "System: found limits = 5; wanted Limits"),
    "a scene for a system": (lambda: vx.march(scene(), TIMES), r"march: found Scene\(.*; wanted a System"),
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


def test_the_scene_of_these_tests_is_in_order():
    """Without a mistake there is no error; each case above differs from this by one."""
    assert run().certificate.max() < 1e-8
    assert vx.march(vx.System(SYMMETRIC, lambda t: [t, t], vx.Norms(np.eye(2), 0.3)), TIMES).certificate.max() < 1e-8


def test_the_slip_in_the_message_is_that_of_the_excess():
    """One slider: 5 pull, 1.5 hold, and a stiffness of 2 takes the rest."""
    system = vx.System([[2.0]], lambda t: [5.0], vx.Norms([[1.0]], [1.5]))
    with pytest.raises(vx.SceneError, match=r"7\.0e-01 .* slips most at norm term 0, by 1\.75\."):
        vx.march(system, TIMES)


SOLVERS = {
    "unknown": (vx.ThroughCvxpy("FOO"), "solver 'FOO': cvxpy does not find it here; it finds .*CLARABEL"),
    "no friction": (vx.Direct(), "solver Direct: the program has absolute values, .* accept the program: Newton"),
    "an option": (vx.Clarabel(options={"speed": 9}), "solver Clarabel: refused the options {'speed': 9}"),
    "cvxpy's option": (vx.ThroughCvxpy("SCS", options={"speed": 9}), "solver SCS: refused the options {'speed': 9}"),
}


@pytest.mark.parametrize("name", SOLVERS)
def test_a_solver_that_cannot_is_named(name):
    solver, says = SOLVERS[name]
    with pytest.raises(vx.NotAccepted, match=f"^{says}"):
        run(solver=solver)


def test_friction_without_contact_is_doubted():
    """The likeliest slip of all: the body rubs on a boundary that nothing presses it against."""
    with pytest.warns(vx.SceneWarning, match="^TrescaFriction on bottom: at 3 of 4 places nothing holds the body"):
        run(contact=None)


def test_advice_can_be_followed():
    """What NotCertified advises must not be refused in turn."""
    lost = vx.OSQP(accuracy=1e-9, options={"max_iter": 1, "polishing": False, "rho": 1e-6, "adaptive_rho": False})
    with pytest.raises(vx.NotCertified) as caught:
        run(solver=lost)
    advised = re.search(r"accuracy=(\S+) or more", str(caught.value))
    assert advised is None or 0 < float(advised.group(1)) < 1
    assert "Status of the solver: user_limit" in str(caught.value)
