"""A user's mistakes: each gives one clear sentence that names its subject, what was found and what to do.

Every message stands here as a pattern; the warnings of numpy and scipy are errors in these tests, so that none escapes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp

import vemcvx as vx
from vemcvx.effects import Contribution, Support

MESH = vx.meshes.squares(3)
TIMES = [0.0, 0.5, 1.0]
EXIST = (
    r"this mesh has 'left', 'right', 'bottom', 'top', 'boundary'; add one with mesh\.with_boundary\(name, predicate\)"
)


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
    return lambda x, t: np.tile([sign * t, 0.0], (len(x), 1))


NOT_REAL = "which does not read as an array of real numbers"
SHAPE = r"wanted 2 components, or an array \(6, 2\), one row a point\.$"
AT_ONCE = r"It must take all points at once and return one value a point\.$"
REMEDY = (
    "Add Clamp, PrescribedDisplacement or BilateralContact where they stop it; friction holds what slides along its "
    "boundary only, and loads hold nothing"
)
NOTHING = "neither a support nor friction"
SYMMETRIC = [[2.0, -1.0], [-1.0, 2.0]]

BOUNDARIES = {
    "unknown name": (lambda: run(clamp=vx.Clamp("rihgt")), rf"^Clamp: there is no boundary named 'rihgt'; {EXIST}\.$"),
    "unknown in a list": (
        lambda: run(friction=vx.TrescaFriction(4.0, ["bottom", "botom"])),
        rf"^TrescaFriction: there is no boundary named 'botom'; {EXIST}\.$",
    ),
    "None": (
        lambda: run(friction=vx.TrescaFriction(4.0, None)),
        rf"^TrescaFriction: there is no boundary named None; {EXIST}\.$",
    ),
    "a number": (lambda: run(clamp=move(0.0, 3, "normal")), rf"no boundary named 3; {EXIST}\.$"),
    "a set": (lambda: run(clamp=vx.Clamp({"right"})), rf"^Clamp: there is no boundary named {{'right'}}; {EXIST}\.$"),
    "an empty list": (
        lambda: run(clamp=vx.Clamp([])),
        r"^Clamp: on= names no boundary; this mesh has 'left', 'right', 'bottom', 'top', 'boundary'\.$",
    ),
    "of a reaction": (lambda: run().reaction("botom"), rf"^reaction: there is no boundary named 'botom'; {EXIST}\.$"),
}

A_MATERIAL = r"^Scene: found 0 materials; a scene has at least one, such as Elasticity\(young=200\.0, poisson=0\.3\)\.$"
EFFECTS = r"; a scene is made of effects, one by one, such as Scene\(Elasticity\(.*\), Clamp\(on=\"right\"\)\)\.$"
SCENES = {
    "no material": (lambda: scene(material=None), A_MATERIAL),
    "nothing at all": (vx.Scene, A_MATERIAL),
    "two materials": (
        lambda: run(other=PARTS["material"]),
        r"^materials: every cell takes exactly one; of 9 cells there are 9 with more than one, the first cell 0 around",
    ),
    "a class": (
        lambda: scene(clamp=vx.Clamp),
        rf"^Scene: found Clamp, the class, where an effect Clamp\(\.\.\.\) is wanted{EFFECTS}",
    ),
    "another class": (lambda: scene(clamp=dict), rf"^Scene: found <class 'dict'>, which is not an effect{EFFECTS}"),
    "a list": (
        lambda: vx.Scene(list(PARTS.values())),
        rf"^Scene: found \[Elasticity.*\], which is not an effect{EFFECTS}",
    ),
    "a name": (lambda: scene(clamp="right"), rf"^Scene: found 'right', which is not an effect{EFFECTS}"),
    "effects for a scene": (
        lambda: run(of=list(PARTS.values())),
        r"^simulate: found \[Elasticity.*\] where the scene goes; give a Scene\(\.\.\.\), then a mesh\.$",
    ),
    "mesh and scene swapped": (
        lambda: vx.simulate(MESH, scene(), TIMES),
        r"^simulate: found PolygonMesh.* where the scene goes; give a Scene\(\.\.\.\), then a mesh\.$",
    ),
    "the name of a mesh": (
        lambda: run(mesh="squares"),
        r"^simulate: found 'squares' where the mesh goes; give a PolygonMesh, such as vemcvx\.meshes\.squares\(16\)\.$",
    ),
    "a family for a mesh": (
        lambda: run(mesh=vx.meshes.squares),
        r"^simulate: found <function squ.*> where the mesh goes; give a PolygonMesh, such as vemcvx\.meshes\.squares",
    ),
    "a mesh without the boundaries": (
        lambda: run(mesh=apart()),
        r"^BilateralContact: there is no boundary named 'bottom'; this mesh has 'first', 'boundary'; add one with",
    ),
}

FLOATING = {
    "no supports": (
        lambda: run(clamp=None, contact=None, friction=None),
        rf"^supports: the body floats: 3 rigid motions meet {NOTHING}, the first .*\. {REMEDY}\.$",
    ),
    "friction alone": (
        lambda: run(clamp=None, contact=None),
        rf"^supports: the body floats: 2 rigid motions meet {NOTHING}, .*\. {REMEDY}\.$",
    ),
    "bilateral bottom alone": (
        lambda: run(clamp=None, friction=None),
        rf"^supports: the body floats: 1 rigid motion meets {NOTHING}, the first the translation \(1, 0\)\. "
        rf"{REMEDY}\.$",
    ),
    "one oblique direction": (
        lambda: run(clamp=move(0.0, "right", (1, 1)), contact=None, friction=None),
        # The edge at x = 1 turns about its far point along (1, 1): a translation with a rotation, or one across (1, 1).
        rf"^supports: the body floats: 1 rigid motion meets {NOTHING}, the first the translation .*\. {REMEDY}\.$",
    ),
    "one corner node": (
        lambda: run(clamp=Pin(0), contact=None, friction=None),
        rf"^supports: the body floats: 1 rigid motion meets {NOTHING}, .* with a rotation\. {REMEDY}\.$",
    ),
    "a second part": (
        lambda: run(mesh=apart(), of=vx.Scene(PARTS["material"], vx.Clamp("first"))),
        rf"^supports: part 2 of 2 of the body floats: 3 rigid motions meet {NOTHING}, .*\. {REMEDY}\.$",
    ),
    "a hinge": (
        lambda: run(mesh=hinged(), of=vx.Scene(PARTS["material"], vx.Clamp("low"))),
        r"^supports: the body is a mechanism: 1 motion\(s\) without strain meet no support\. Cells that share "
        r"single nodes, "
        r"such as node 2 at \[1\. 1\.\], turn about them like hinges\. Join the cells along edges, or support "
        r"each piece\.$",
    ),
}

DATA = {
    "negative bound": (
        lambda: run(friction=vx.TrescaFriction(-1.0, "bottom")),
        r"^TrescaFriction on bottom: found bound = -1 at \[0\. 0\.\] and t = 0; .* must be >= 0\.$",
    ),
    "negative bound somewhere": (
        lambda: run(friction=vx.TrescaFriction(lambda x, t: 0.5 - t * x[:, 0], "bottom", quadrature="integral")),
        r"^TrescaFriction on bottom: found bound = -0\.47.* at \[0\.97\d* 0\. *\] and t = 1; .* must be >= 0\.$",
    ),
    "NaN load": (
        lambda: run(load=vx.Traction((np.nan, 0.0), "left")),
        r"^Traction on left: found NaN or infinity in 6 of 12 values, first at .* and t = 0; all must be finite\.$",
    ),
    "NaN load later": (
        lambda: run(load=vx.Traction(lambda x, t: np.where(t > 0.6, np.nan, 0.0) + 0 * x, "left")),
        r"^Traction on left: found NaN or infinity in 12 of 12 values, first at .* and t = 1; all must be finite\.$",
    ),
    "infinite bound": (
        lambda: run(friction=vx.TrescaFriction(np.inf, "bottom")),
        r"^TrescaFriction on bottom: bound: found NaN or infinity in 4 of 4 values, first at .* must be finite\.$",
    ),
    "no t": (
        lambda: run(load=vx.Traction(lambda x: x, "left")),
        rf"^Traction on left: its function failed when called as f\(x, t\) with x of shape \(6, 2\): TypeError: "
        rf".*\. {AT_ONCE}",
    ),
    "one point at a time": (
        lambda: run(load=vx.Traction(lambda x, t: (1.0, 0.0) if x[0] > 0 else (0.0, 0.0), "left")),
        rf"^Traction on left: its function failed .*x of shape \(6, 2\): ValueError: .* is ambiguous\. .*{AT_ONCE}",
    ),
    "f(x, t) for a modulus": (
        lambda: run(material=vx.Elasticity(lambda x, t: 200.0, 0.3)),
        rf"^Elasticity: young: its function failed when called as f\(x\) with x of shape \(9, 2\): TypeError: .* "
        rf"{AT_ONCE}",
    ),
    "one component": (
        lambda: run(load=vx.Traction(3.0, "left")),
        rf"^Traction on left: found the single number 3; {SHAPE}",
    ),
    "three components": (
        lambda: run(load=vx.Traction((1, 2, 3), "left")),
        rf"^Traction on left: found an array of shape \(3,\); {SHAPE}",
    ),
    "components first": (
        lambda: run(load=vx.Traction(lambda x, t: x.T, "left")),
        rf"^Traction on left: found an array of shape \(2, 6\); {SHAPE}",
    ),
    "scalars for vectors": (
        lambda: run(load=vx.Traction(lambda x, t: x[:, 0], "left")),
        rf"^Traction on left: found an array of shape \(6,\); {SHAPE}",
    ),
    "nothing returned": (
        lambda: run(load=vx.Traction(lambda x, t: None, "left")),
        rf"^Traction on left: found None, {NOT_REAL}; {SHAPE}",
    ),
    "strings returned": (
        lambda: run(load=vx.Traction(lambda x, t: [["1", "2"]] * len(x), "left")),
        rf"^Traction on left: found \[\['1', '2'\], .*\], {NOT_REAL}; {SHAPE}",
    ),
    "complex returned": (
        lambda: run(load=vx.Traction(lambda x, t: 1j * x, "left")),
        rf"^Traction on left: found array.*, {NOT_REAL}; {SHAPE}",
    ),
    "ragged returned": (
        lambda: run(load=vx.BodyForce(lambda x, t: [[1, 2], [3]])),
        rf"^BodyForce: found \[\[1, 2\], \[3\]\], {NOT_REAL}; wanted 2 components, or an array \(36, 2\), one "
        rf"row a point\.$",
    ),
    "a name for a bound": (
        lambda: run(friction=vx.TrescaFriction("g", "bottom")),
        rf"^TrescaFriction on bottom: bound: found 'g', {NOT_REAL}; wanted a number, or \(4,\) values, one a point\.$",
    ),
    "vector for one direction": (
        lambda: run(clamp=move((0.0, 0.0), "right", "normal")),
        r"^PrescribedDisplacement on right: found an array of shape \(2,\); wanted a number, or \(4,\) values",
    ),
    "number for both directions": (
        lambda: run(clamp=move(0.0, "right")),
        r"^PrescribedDisplacement on right: found the single number 0; wanted 2 components, or an array \(4, 2\)",
    ),
}

MATERIALS = {
    "incompressible": (
        lambda: run(material=vx.Elasticity(1.0, 0.5)),
        r"^Elasticity: found poisson = 0\.5 in cell 0; it must be > -1 and < 0\.5 in plane strain "
        r"\(use 0\.4999999, or plane='stress'\)\.$",
    ),
    "poisson in one cell": (
        lambda: run(material=vx.Elasticity(1.0, np.where(np.arange(9) == 4, 0.7, 0.3), plane="stress")),
        r"^Elasticity: found poisson = 0\.7 in cell 4; it must be > -1 and <= 0\.5\.$",
    ),
    "poisson -1": (lambda: run(material=vx.Elasticity(1.0, -1)), r"found poisson = -1 in cell 0; it must be > -1 and"),
    "young 0": (
        lambda: run(material=vx.Elasticity(0, 0.3)),
        r"^Elasticity: found young = 0 in cell 0; Young's modulus must be > 0\.$",
    ),
    "young negative": (
        lambda: run(material=vx.Elasticity(lambda x: 0.5 - x[:, 0] - 0.1 * x[:, 1], 0.3)),
        r"^Elasticity: found young = -0\.416667 in cell 8; Young's modulus must be > 0\.$",
    ),
    "young None": (
        lambda: run(material=vx.Elasticity(None, 0.3)),
        rf"^Elasticity: young: found None, {NOT_REAL}; wanted a number, or \(9,\) values, one a cell\.$",
    ),
    "young NaN": (
        lambda: run(material=vx.Elasticity(np.where(np.arange(9) == 7, np.nan, 1.0), 0.3)),
        r"^Elasticity: young: found NaN or infinity in 1 of 9 values, first in cell 7; all must be finite\.$",
    ),
    "wrong length": (
        lambda: run(material=vx.Elasticity(np.ones(4), 0.3)),
        r"^Elasticity: young: found an array of shape \(4,\); wanted a number, or \(9,\) values, one a cell\.$",
    ),
    "unknown cell datum": (
        lambda: run(material=vx.Elasticity("stiff", 0.3)),
        r"^Elasticity: young: the mesh has no cell datum named 'stiff'; it has none\. Add one with "
        r"mesh\.with_cell_data\(",
    ),
    "misspelt cell datum": (
        lambda: run(mesh=MESH.with_cell_data("nu", np.ones(9) / 4), material=vx.Elasticity(1.0, "mu")),
        r"^Elasticity: poisson: the mesh has no cell datum named 'mu'; it has 'nu'\. Add one ",
    ),
    "plane": (
        lambda: run(material=vx.Elasticity(1.0, 0.3, plane="foo")),
        r"^Elasticity: found plane 'foo'; there are 'strain' and 'stress'\.$",
    ),
    "stabilisation": (
        lambda: run(material=vx.Elasticity(1.0, 0.3, stabilisation="foo")),
        r"^Elasticity: found stabilisation 'foo'; there are 'shear' and 'unit'\.$",
    ),
}

WANTED_TIMES = r"wanted an increasing sequence of finite instants, such as np\.linspace\(0, 1, 65\)\.$"
INSTANTS = {
    "decreasing": (
        lambda: run(times=[0, 1, 0.5]),
        r"^times: instant 2 is 0\.5, which does not come after instant 1, 1; times must increase strictly\.$",
    ),
    "repeated": (
        lambda: run(times=[0, 0.5, 0.5]),
        r"^times: instant 2 is 0\.5, which does not come after instant 1, 0\.5; times must increase strictly\.$",
    ),
    "NaN": (lambda: run(times=[0, np.nan]), rf"^times: found \[0, nan\]; {WANTED_TIMES}"),
    "infinite": (lambda: run(times=[0, np.inf]), rf"^times: found \[0, inf\]; {WANTED_TIMES}"),
    "empty": (lambda: run(times=[]), rf"^times: found \[\]; {WANTED_TIMES}"),
    "two axes": (lambda: run(times=[[0, 1.0]]), rf"^times: found \[\[0, 1\.0\]\]; {WANTED_TIMES}"),
    "one number": (lambda: run(times=1.0), rf"^times: found 1\.0; {WANTED_TIMES}"),
    "None": (lambda: run(times=None), rf"^times: found None, {NOT_REAL}; {WANTED_TIMES}"),
    "words": (lambda: run(times=["a", "b"]), rf"^times: found \['a', 'b'\], {NOT_REAL}; {WANTED_TIMES}"),
    "ragged": (lambda: run(times=[[0], [1, 2]]), rf"^times: found \[\[0\], \[1, 2\]\], {NOT_REAL}; {WANTED_TIMES}"),
}

STATE = (
    r"wanted {}displacements of shape \(16, 2\), one row a node, or None, 'equilibrium', 'settled' or, "
    r"of a function f\(x, t\), vx\.projected\(f\)\.$"
)
INITIAL = {
    "wrong shape": (
        lambda: run(initial=np.zeros(3)),
        rf"^initial: found an array of shape \(3,\); {STATE.format('')}",
    ),
    "components first": (
        lambda: run(initial=np.zeros((2, 16))),
        rf"^initial: found an array of shape \(2, 16\); {STATE.format('')}",
    ),
    "a number": (lambda: run(initial=0.0), rf"^initial: found the single number 0; {STATE.format('')}"),
    "a function": (
        lambda: run(initial=lambda x, t: 0.0 * x),
        rf"^initial: found <function .*, {NOT_REAL}; {STATE.format('')}",
    ),
    "NaN": (
        lambda: run(initial=np.where(np.arange(32).reshape(16, 2) == 11, np.nan, 0.0)),
        r"^initial: found NaN or infinite values; all must be finite\.$",
    ),
    "not numbers": (
        lambda: run(initial=[["a", "b"]]),
        rf"^initial: found \[\['a', 'b'\]\], {NOT_REAL}; {STATE.format('')}",
    ),
    "complex": (lambda: run(initial=1j * MESH.points), rf"^initial: found array.*, {NOT_REAL}; {STATE.format('')}"),
    "a word": (
        lambda: run(initial="settle"),
        r"^initial: found 'settle'; there are None \(zero\), an array, 'equilibrium' \(no friction\) and "
        r"'settled' \(one step",
    ),
    "off its supports": (
        lambda: run(initial=np.ones((16, 2))),
        r"^initial: the displacement \[1\. 1\.\] of node 0 at \[0\. 0\.\] contradicts its supports at t = 0, by 1\. "
        r"Give an initial displacement that obeys them, or initial='settled'\.$",
    ),
    "zero on supports that have moved": (
        lambda: run(clamp=move((0.25, 0.0), "right")),
        r"^initial: the displacement \[0\. 0\.\] of node \d+ at \[1\. .*\] contradicts its supports at t = 0, by "
        r"0\.25\. "
        r".*or initial='settled'\.$",
    ),
    "more than friction holds": (
        lambda: run(load=vx.Traction((50.0, 0.0), "left")),
        r"^initial: the state at t = 0 is not held by friction \(condition \(2\.1\)\): one step there moves it "
        r"by 9\.7e-01 of "
        r"the energy norm, allowed is 1e-06\. The worst place is node 0 at \(0\.0, 0\.0\), where holding still "
        r"takes a force of "
        r"11\.3\d*, 10\.6\d* over the bound 0\.666667\. If something acts from the start, say initial='settled', in a "
        r"problem file too: the body begins at rest under it, one step from zero\. Or start from 'equilibrium'",
    ),
    "a load from the start, no friction": (
        lambda: run(load=vx.Traction((50.0, 0.0), "left"), friction=None),
        r"^initial: the state at t = 0 is not in equilibrium .* moves it by 1\.0e\+00 of the energy norm.* say "
        r"initial='settled', .*with a load that begins at zero\.$",
    ),
    "of a system": (
        lambda: vx.march(vx.System(SYMMETRIC, lambda t: [t, t]), TIMES, initial=[1, 2, 3]),
        r"^initial: found an array of shape \(3,\); wanted 2 finite values, one an unknown\.$",
    ),
    "NaN of a system": (
        lambda: vx.march(vx.System(SYMMETRIC, lambda t: [t, t]), TIMES, initial=[0, np.nan]),
        r"^initial: found NaN or infinity in unknown 1; wanted 2 finite values, one an unknown\.$",
    ),
}

PRESCRIBED = {
    "against each other": (
        lambda: run(clamp=None, other=move(along(1), "top"), another=move(along(-1), "left"), load=None),
        r"^PrescribedDisplacement on top: node 12 at \[0\. 1\.\] is to move by 0\.5 along \[1\. 0\.\] at t = "
        r"0\.5, but other "
        r"supports already move it by -0\.5\. Prescribe each direction of a node once\.$",
    ),
    "against a clamp": (
        lambda: run(other=move(along(1), "top")),
        r"^PrescribedDisplacement on top: node 15 at \[1\. 1\.\] is to move by 0\.5 along \[1\. 0\.\] at t = "
        r"0\.5, but other "
        r"supports already move it by 0\. Prescribe each direction of a node once\.$",
    ),
    "one component against a clamp": (
        lambda: run(other=move(lambda x, t: -t * np.ones(len(x)), "top", (3, 4))),
        r"^PrescribedDisplacement on top: node 15 at \[1\. 1\.\] is to move by -0\.5 along \[0\.6 0\.8\] at t = "
        r"0\.5, but other",
    ),
    "zero direction": (
        lambda: run(clamp=move(0.0, "right", (0, 0))),
        r"^PrescribedDisplacement on right: found direction \(0, 0\); wanted a nonzero vector of 2 finite components, "
        r"'normal', 'tangent', or None \(all components\)\.$",
    ),
    "direction in space": (
        lambda: run(clamp=move(0.0, "right", (1, 0, 0))),
        r"found direction \(1, 0, 0\); wanted a nonzero vector of 2 finite components, 'normal', 'tangent', or None",
    ),
    "direction NaN": (
        lambda: run(clamp=move(0.0, "right", (np.nan, 0))),
        r"found direction \(nan, 0\); wanted a nonzero vector of 2 finite components, 'normal', 'tangent', or None",
    ),
    "direction ragged": (
        lambda: run(clamp=move(0.0, "right", ((1, 2), (3,)))),
        rf"direction: found \(\(1, 2\), \(3,\)\), {NOT_REAL}; wanted a nonzero vector of 2 finite components",
    ),
    "unknown direction": (
        lambda: run(clamp=move(0.0, "right", "foo")),
        r"^PrescribedDisplacement on right: direction: found 'foo', .* vector of 2 .*, 'normal', 'tangent', or None",
    ),
}

STORE = r"there are 'all', 'last', an integer n >= 1 .*, or a sequence of step numbers from 0 to 2\.$"
CHOICES = {
    "quadrature": (
        lambda: run(friction=vx.TrescaFriction(1.0, "bottom", quadrature="foo")),
        r"^TrescaFriction on bottom: found quadrature 'foo'; there are 'nodes' and 'integral'\.$",
    ),
    "store word": (lambda: run(store="foo"), rf"^store: found 'foo'; {STORE}"),
    "store 0": (lambda: run(store=0), rf"^store: found 0; {STORE}"),
    "store half": (lambda: run(store=1.5), rf"^store: found 1\.5; {STORE}"),
    "store true": (lambda: run(store=True), rf"^store: found True; {STORE}"),
    "store steps": (lambda: run(store=np.array([1, 3])), rf"^store: found array\(\[1, 3\]\); {STORE}"),
    "a step not stored": (
        lambda: run(store="last").stress(1),
        r"^history: step 1 was not stored; stored are \[2\] of 0 \.\.\. 2\.$",
    ),
    "accuracy too small": (
        lambda: vx.Newton(accuracy=0),
        r"^Newton: found accuracy = 0; it is a relative energy error between 0 and 1, such as 1e-6\.$",
    ),
    "accuracy too large": (lambda: vx.Clarabel(accuracy=1.5), r"^Clarabel: found accuracy = 1\.5; .* between 0 and 1"),
    "accuracy no number": (lambda: vx.ThroughCvxpy("SCS", "x"), r"^SCS: found accuracy = 'x'; .* between 0 and 1"),
    "a solver's name": (
        lambda: run(solver="newton"),
        r"^solver: found 'newton'; wanted a solver with its settings, such as Newton\(accuracy=1e-8\), or None",
    ),
    "a linear solver's name": (
        lambda: run(linear="superlu"),
        r"^linear: found 'superlu'; wanted SuperLU\(\), Pardiso\(\), Iterative\(\), PETSc\(\), or None \(chosen\)\.$",
    ),
    "a linear solver's class": (
        lambda: run(linear=vx.SuperLU),
        r"^linear: found <class .*SuperLU'>; wanted SuperLU\(\), Pardiso\(\), Iterative\(\), PETSc\(\), or None",
    ),
    "progress": (lambda: run(progress="yes"), r"^progress: found 'yes'; wanted a function of \(step, steps\)\.$"),
    "a solver's class": (
        lambda: run(solver=vx.Newton),
        r"^solver: found <class .*Newton'>; wanted a solver with its settings, such as Newton\(accuracy=1e-8\), "
        r"or None",
    ),
}

SYSTEMS = {
    "not a matrix": (
        lambda: vx.System("K", pull),
        rf"^System: K: found 'K', {NOT_REAL}; wanted a matrix of real numbers\.$",
    ),
    "one axis": (
        lambda: vx.System(np.ones(3), pull),
        r"^System: K: found an array of shape \(3,\); wanted a matrix, dense or sparse\.$",
    ),
    "not square": (
        lambda: vx.System(np.ones((2, 3)), pull),
        r"^System: K: found a matrix of shape \(2, 3\); it must be square\.$",
    ),
    "complex, sparse": (lambda: vx.System(sp.csr_array(1j * np.eye(2)), pull), rf"^System: K: found .*, {NOT_REAL}"),
    "NaN": (
        lambda: vx.System(np.nan * np.eye(2), pull),
        r"^System: K: found NaN or infinite values; all must be finite\.$",
    ),
    "not symmetric": (
        lambda: vx.System([[2.0, 1.0], [0.0, 2.0]], pull),
        r"^System: K: found 1 at \[0, 1\] but 0 at \[1, 0\]; it must be symmetric\. For the energy .* give \(K \+ "
        r"K\.T\) / 2\.$",
    ),
    "not positive": (
        lambda: vx.System(np.diag([1.0, -1.0]), pull),
        r"^System: found K\[1, 1\] = -1; K must be positive definite\.$",
    ),
    "singular": (
        lambda: vx.march(vx.System([[1.0, -1.0], [-1.0, 1.0]], lambda t: [0, 0]), TIMES),
        r"^the stiffness matrix is singular or indefinite: some motion of the body costs no energy, or gains some\.",
    ),
    "load of a constant": (
        lambda: vx.System(SYMMETRIC, np.ones(2)),
        r"^System: found load = array\(\[1\., 1\.\]\); wanted a function of t that gives \(2,\) forces\.$",
    ),
    "load of wrong signature": (
        lambda: vx.march(vx.System(SYMMETRIC, lambda: 0), TIMES),
        r"^System: load: its function failed when called as f\(t\) with t = 0: TypeError: .*\. It must take an "
        r"instant and "
        r"return an array\.$",
    ),
    "load of wrong shape": (
        lambda: vx.march(vx.System(SYMMETRIC, lambda t: [t, t, t]), TIMES),
        r"^System: load\(0\): found an array of shape \(3,\); wanted \(2,\) forces, one an unknown\.$",
    ),
    "load of words": (
        lambda: vx.march(vx.System(SYMMETRIC, lambda t: "up"), TIMES),
        rf"^System: load\(0\): found 'up', {NOT_REAL}; wanted \(2,\) forces, one an unknown\.$",
    ),
    "load NaN": (
        lambda: vx.march(vx.System(SYMMETRIC, lambda t: [0, np.nan if t else 0]), TIMES),
        r"^System: load\(0\.5\): found NaN or infinite values; all must be finite\.$",
    ),
    "blocks": (
        lambda: vx.Norms(np.eye(3), 1.0, block=2),
        r"^Norms: found B with 3 rows and block = 2; B must have a whole number of blocks of rows\.$",
    ),
    "negative weight": (
        lambda: vx.Norms(np.eye(2), [1.0, -3.0]),
        r"^Norms: found the weight -3 of norm term 1; it must be >= 0\.$",
    ),
    "negative weight later": (
        lambda: vx.march(vx.System(SYMMETRIC, lambda t: [t, t], vx.Norms(np.eye(2), lambda t: 0.7 - t)), TIMES),
        r"^Norms: found the weight -0\.3 of norm term 0; it must be >= 0\.$",
    ),
    "weights of wrong number": (
        lambda: vx.Norms(np.eye(2), [1.0, 2.0, 3.0]),
        r"^Norms: w: found an array of shape \(3,\); wanted a weight, or \(2,\) of them, one a term\.$",
    ),
    "weights that fail": (
        lambda: vx.march(vx.System(SYMMETRIC, lambda t: [t, t], vx.Norms(np.eye(2), lambda: 1)), TIMES),
        r"^Norms: w: its function failed when called as f\(t\) with t = 0: TypeError: .*return an array\.$",
    ),
    "columns": (
        lambda: vx.System(SYMMETRIC, pull, vx.Norms(np.eye(3), 1.0)),
        r"^System: found norms over 3 unknowns, but K has 2; B must have one column an unknown\.$",
    ),
    "norms that are a matrix": (
        lambda: vx.System(SYMMETRIC, pull, np.eye(2)),
        r"^System: found norms = array.*; wanted Norms\(B, w\), or None\.$",
    ),
    "an order that is none": (
        lambda: vx.System(SYMMETRIC, pull, order=np.array([0, 0])),
        r"^System: found order = array\(\[0, 0\]\); wanted a permutation of the 2 unknowns, or None\.$",
    ),
    "a scene for a system": (
        lambda: vx.march(scene(), TIMES),
        r"^march: found Scene\(.* where the System goes; simulate\(\) takes a scene and a mesh\.$",
    ),
}

MISTAKES = {
    f"{about}: {name}": case
    for about, cases in {
        "boundary": BOUNDARIES,
        "scene": SCENES,
        "floating": FLOATING,
        "data": DATA,
        "material": MATERIALS,
        "times": INSTANTS,
        "initial": INITIAL,
        "prescribed": PRESCRIBED,
        "choice": CHOICES,
        "system": SYSTEMS,
    }.items()
    for name, case in cases.items()
}


@pytest.mark.parametrize(("mistake", "message"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_gives_one_clear_sentence(mistake, message):
    with pytest.raises(vx.SceneError) as caught:
        mistake()
    words = str(caught.value)
    assert re.search(message, words), words
    assert "\n" not in words
    assert words.endswith(".")
    assert len(words) < 500


def test_the_scene_of_these_tests_is_in_order():
    """Without a mistake there is no error; each case above differs from this by one."""
    assert run().certificate.max() < 1e-8
    assert vx.march(vx.System(SYMMETRIC, lambda t: [t, t], vx.Norms(np.eye(2), 0.3)), TIMES).certificate.max() < 1e-8


@pytest.mark.parametrize("start", ["settled", "equilibrium"])
def test_the_remedies_for_an_initial_violation_are_accepted(start):
    history = run(load=vx.Traction((50.0, 0.0), "left"), initial=start)
    assert np.abs(history.displacement[0]).max() > 0.1
    # A constant load: what was reached at once stays.
    assert np.abs(history.displacement - history.displacement[0]).max() < 1e-12 * np.abs(history.displacement).max()


def test_the_excess_in_the_message_is_that_over_the_bound():
    """One slider: holding still takes the whole load."""
    system = vx.System([[2.0]], lambda t: [5.0], vx.Norms([[1.0]], [1.5]))
    with pytest.raises(
        vx.SceneError,
        match=r"moves it by 7\.0e-01 .*The worst place is norm term 0, where holding still takes a force of 5, "
        r"3\.5 over the bound 1\.5\.",
    ):
        vx.march(system, TIMES)


@pytest.mark.parametrize("name", ["FOO", "SCIPY "])
def test_an_unknown_cvxpy_solver(name):
    with pytest.raises(
        vx.NotAccepted,
        match=rf"^solver {name!r}: cvxpy does not find it here; it finds .*CLARABEL.*OSQP.* choose one of those",
    ):
        run(solver=vx.ThroughCvxpy(name))


def test_a_solver_that_takes_no_friction():
    with pytest.raises(
        vx.NotAccepted,
        match=r"^solver Direct: the program has absolute values, which it does not accept; it accepts quadratic\. "
        r"These accept the program: Newton, OSQP, Clarabel\.$",
    ):
        run(solver=vx.Direct())


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: vx.TrescaFriction(4.0, on="bottom", mu=0.3), "unexpected keyword argument 'mu'"),
        (lambda: vx.Clamp(), "missing 1 required positional argument: 'on'"),
        (lambda: vx.simulate(scene(), MESH), "missing 1 required positional argument: 'times'"),
        (lambda: vx.simulate(scene(), MESH, TIMES, tolerance=1e-6), "unexpected keyword argument 'tolerance'"),
    ],
    ids=["unknown", "missing", "no times", "unknown option"],
)
def test_arguments_that_do_not_exist_are_pythons_own_error(call, message):
    with pytest.raises(TypeError, match=message):
        call()


def test_triangles_near_incompressibility_are_warned_of():
    with pytest.warns(
        vx.SceneWarning,
        match=r"^Elasticity: poisson = 0\.4999 on a mesh of triangles, which lock near 1/2; polygons \(squares, "
        r".* do not\.$",
    ):
        run(mesh=vx.meshes.triangles(2), material=vx.Elasticity(200.0, 0.4999))


@dataclass(frozen=True)
class Bar(vx.Effect):
    """An effect of one's own that fails: its error is its own."""

    def contribute(self, space):
        raise ZeroDivisionError("mine")

    def describe(self):
        return "Bar"


def test_errors_of_ones_own_effects_pass_unchanged():
    with pytest.raises(ZeroDivisionError, match="mine"):
        run(other=Bar())


def test_friction_without_contact_is_doubted():
    """The likeliest slip of all: the body rubs on a boundary that nothing presses it against."""
    warned = (
        r"^TrescaFriction on bottom: at 3 of 4 places nothing holds the body in the normal direction; add Bilateral"
    )
    with pytest.warns(vx.SceneWarning, match=warned):
        run(contact=None)


def test_an_indefinite_stiffness_is_refused():
    K = np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    system = vx.System(K, lambda t: np.ones(3) * t, vx.Norms(np.eye(3)[2:], [1.0]))
    with pytest.raises(vx.SceneError, match="^the stiffness matrix is singular or indefinite"):
        vx.march(system, TIMES)


@pytest.mark.parametrize("limit", [0, -1, 2.5, "many"])
def test_newton_needs_an_iteration(limit):
    with pytest.raises(
        vx.SceneError, match=r"^Newton: found max_iterations = .*whole number of linear solves, at least 1"
    ):
        vx.Newton(max_iterations=limit)


@pytest.mark.parametrize("solver", [vx.Clarabel(options={"speed": 9}), vx.ThroughCvxpy("SCS", options={"speed": 9})])
def test_an_unknown_option_of_a_solver_is_named(solver):
    with pytest.raises(vx.NotAccepted, match=r"^solver (Clarabel|SCS): refused the options {'speed': 9}.*its own"):
        run(solver=solver)


def test_accuracies_of_any_real_type_are_taken():
    assert run(solver=vx.Newton(accuracy=np.float32(1e-3))).certificate.max() < 1e-3


def test_advice_can_be_followed():
    """What NotCertified advises must not be refused in turn."""
    lost = vx.OSQP(accuracy=1e-9, options={"max_iter": 1, "polishing": False, "rho": 1e-6, "adaptive_rho": False})
    with pytest.raises(vx.NotCertified) as caught:
        run(solver=lost)
    advised = re.search(r"accuracy=(\S+) or more", str(caught.value))
    assert advised is None or 0 < float(advised.group(1)) < 1
    assert "The solver said: user_limit" in str(caught.value)
