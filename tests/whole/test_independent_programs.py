"""Every kind of scene is compared with an independent program, written with scikit-fem, cvxpy and Clarabel.

On triangles, virtual elements are linear elements, so that the package and the independent program have the same
discrete solution. They agree to 1e-8 in displacement, traction, pressure, reactions, energy, work and dissipation, over
steps with reversals; see :mod:`independent_p1`.

A scene is a tuple of parts. A part is a pair: an effect of the package, and a function that adds the same effect to the
body of the independent program. Supports come before contact, and contact before friction.
"""

from __future__ import annotations

import numpy as np
import pytest
from independent_p1 import AGREE, TIMES, Body, March, scalar, vector

import vemcvx as vx

E, NU = 200.0, 0.3


# Parts of scenes


def elastic(young=E, poisson=NU, plane="strain"):
    return vx.Elasticity(young, poisson, plane=plane), lambda other: other.isotropic(young, poisson, plane)


def clamp(on="right"):
    return vx.Clamp(on=on), lambda other: other.clamp(on)


def move(value, on="top"):
    return vx.PrescribedDisplacement(vector(value), on=on), lambda other: other.move(on, value)


def pull(size=8.0, lift=-0.1):
    """Return a traction on the left that reverses twice per unit of time."""

    def force(x, y, t):
        return size * np.sin(7 * t) * (0.75 + 0.5 * y), lift * size * t + 0 * x

    return vx.Traction(vector(force), on="left"), lambda other: other.traction("left", force)


def press(size):
    """Return a pressure on the top that grows until t = 1/3."""

    def pressure(x, y, t):
        return size * min(3 * t, 1.0) * (1 + 0.3 * x)

    return vx.Pressure(scalar(pressure), on="top"), lambda other: other.pressure("top", pressure)


def springs(normal, tangential, on):
    foundation = vx.ElasticFoundation(normal, tangential, on=on)
    return foundation, lambda other: other.springs(on, normal, tangential)


def dashpots():
    return vx.Viscosity(30.0, 10.0), lambda other: other.viscous(30.0, 10.0)


def bilateral():
    return vx.BilateralContact(on="bottom"), lambda other: other.bilateral("bottom")


def floor(gap=lambda x, y, t: 0.0):
    return vx.UnilateralContact(on="bottom", gap=scalar(gap)), lambda other: other.wall("bottom", gap)


def soft_floor(stiffness, gap=lambda x, y, t: 0.0):
    compliance = vx.NormalCompliance(stiffness, on="bottom", gap=scalar(gap))
    return compliance, lambda other: other.wall("bottom", gap, stiffness)


def tresca(bound, quadrature="nodes"):
    friction = vx.TrescaFriction(scalar(bound), on="bottom", quadrature=quadrature)
    return friction, lambda other: other.rub("bottom", bound, integrated=quadrature == "integral")


def coulomb(coefficient):
    friction = vx.CoulombFriction(lambda x, t: coefficient(x[:, 0], x[:, 1]) + 0 * x[:, 0], on="bottom")
    return friction, lambda other: other.rub("bottom", coefficient=coefficient)


def constant(value):
    return lambda *_: value


# Parts that depend on the mesh or occur in one scene only


def heat():
    def temperature(x, y, t):
        return 40 * np.sin(5 * t) * (1 + x * 0.5 - y)

    return vx.ThermalStrain(1e-3, scalar(temperature)), lambda other: other.heat(1e-3, temperature)


def orthotropic():
    return (
        vx.Orthotropic((300.0, 60.0), 0.25, 40.0, 0.6),
        lambda other: other.orthotropic(300.0, 60.0, 0.25, 40.0, 0.6),
    )


def body_force():
    def force(x, y, t):
        return np.sin(6 * t) * (3 + x), -2 * t * y

    return vx.BodyForce(vector(force)), lambda other: other.body_force(force)


def prestress():
    def stress(x, y, t):
        return 4 * t * (1 + x), -3 * t + 0 * x, 2 * np.sin(5 * t) * y

    return vx.Prestress(vector(stress)), lambda other: other.prestress(stress)


def force_at_corner(mesh):
    """Return a force on the upper left node."""
    node = int(np.argmin(np.abs(np.array(mesh.points) - [0.0, 1.0]).sum(axis=1)))
    load = vx.PointLoad(lambda x, t: [[2 * np.sin(6 * t), -t]], at=np.array(mesh.points)[node])
    return load, lambda other: other.point_force(node, lambda t: np.array([2 * np.sin(6 * t), -t]))


def roller():
    return vx.Symmetry(on="right"), lambda other: other.guide("right", (1, 0), constant(0.0))


def guide_down():
    def down(x, y, t):
        return -0.02 * min(2 * t, 1)

    guided = vx.PrescribedDisplacement(scalar(down), on="top", direction="normal")
    return guided, lambda other: other.guide("top", (0, 1), down)


def guide_along():
    """Return a motion along the tangent of the top. This tangent points to the left."""

    def along(x, y, t):
        return 0.02 * np.sin(6 * t)

    guided = vx.PrescribedDisplacement(lambda x, t: -scalar(along)(x, t), on="top", direction="tangent")
    return guided, lambda other: other.guide("top", (1, 0), along)


def hard_core(mesh):
    """Yield two materials. The hard material reaches the floor."""
    hard = np.abs(np.array(mesh.centroids)[:, 0] - 0.5) < 0.25
    young, poisson = np.where(hard, 2000.0, E), np.where(hard, 0.2, 0.35)
    yield vx.Elasticity(2000.0, 0.2, on="hard"), lambda other: other.isotropic(young, poisson)
    yield vx.Elasticity(E, 0.35, on="soft"), lambda other: other


def swing(x, y, t):
    return 0.03 * np.sin(7 * t) * (1 + 0.2 * x), -0.01 * t * x


def lift(x, y, t):
    return 0.01 * np.sin(5 * t) * (1 + y), -0.004 * t + 0 * x


SCENES = {
    "tresca": lambda mesh: (elastic(), clamp(), pull(), bilateral(), tresca(lambda x, y, t: 3 + x - t)),
    "tresca integrated": lambda mesh: (
        *(elastic(), clamp(), pull(), bilateral()),
        tresca(lambda x, y, t: 1 + x**2 + x * t, "integral"),
    ),
    "signorini": lambda mesh: (elastic(), clamp(), pull(), press(2), floor(lambda x, y, t: 0.002 * (1 - x) * x)),
    "moving gap": lambda mesh: (
        *(elastic(), clamp(), pull(4), press(1)),
        floor(lambda x, y, t: 0.003 * (1 + np.cos(9 * t)) * (1 + x)),
        tresca(constant(0.5)),
    ),
    "coulomb": lambda mesh: (
        elastic(),
        clamp(),
        pull(3, lift=0),
        press(4),
        floor(),
        coulomb(lambda x, y: 0.3 + 0.1 * x),
    ),
    "viscous": lambda mesh: (elastic(), dashpots(), clamp(), pull(), bilateral(), tresca(constant(2.0))),
    "viscous and moved": lambda mesh: (
        elastic(),
        dashpots(),
        move(lift),
        floor(constant(0.001)),
        tresca(constant(0.4)),
    ),
    "heated": lambda mesh: (elastic(), clamp(), pull(4), heat(), floor(constant(0.001)), tresca(constant(9.0))),
    "orthotropic": lambda mesh: (orthotropic(), clamp(), pull(), bilateral(), tresca(constant(2.0))),
    "on springs": lambda mesh: (
        *(elastic(), springs(150.0, 60.0, "right"), pull(4), body_force()),
        bilateral(),
        tresca(constant(2.5)),
    ),
    "moved": lambda mesh: (elastic(), move(swing), bilateral(), tresca(constant(2.0))),
    "unclamped": lambda mesh: (elastic(), pull(2, lift=0), press(2), bilateral(), tresca(lambda x, y, t: 4.0 - x)),
    "unclamped coulomb": lambda mesh: (elastic(), pull(0.4, lift=0), press(2), floor(), coulomb(constant(0.5))),
    "two materials": lambda mesh: (*hard_core(mesh), clamp(), pull(4), press(3), floor(), tresca(constant(1.0))),
    "prestressed": lambda mesh: (
        *(elastic(), roller(), force_at_corner(mesh), prestress(), springs(20.0, 20.0, "top")),
        soft_floor(300.0),
        tresca(lambda x, y, t: 0.5 + y),
    ),
    "soft floor": lambda mesh: (
        *(elastic(plane="stress"), clamp(), pull(3, lift=0), press(4)),
        soft_floor(500.0, lambda x, y, t: 0.001 * x),
        coulomb(constant(0.35)),
    ),
    "guided": lambda mesh: (elastic(), guide_down(), guide_along(), floor(), coulomb(constant(0.3))),
}
SLOW = ("soft floor", "guided")


def sum_at_nodes(rows_of, values, n, per_length=True):
    """Return sums (instants, n, 2) of value * direction, divided by lengths if `per_length`."""
    out, column = np.zeros((len(values), n, 2)), 0
    for rows, *_ in rows_of:
        part = values[:, column : column + len(rows.nodes)] / (rows.lengths if per_length else 1.0)
        np.add.at(out, (slice(None), rows.nodes), part[:, :, None] * rows.directions)
        column += len(rows.nodes)
    return out


def compare(scene, other, mesh, times):
    """Return the relative difference of each quantity, and the independent result."""
    mine, theirs = vx.simulate(scene, mesh, times, solver=vx.Newton(accuracy=1e-10)), March(other).run(times)
    contact, floor = mine.contact, other.rows("bottom")
    at = np.searchsorted(floor.nodes, contact.nodes)
    # The pressure comes from the vertical component of all nodal forces except friction.
    across = theirs.forces + sum_at_nodes(other.rubs, theirs.lam, other.n, per_length=False)
    pairs = {
        "displacement": (mine.displacement, theirs.displacement),
        "traction": (contact.traction, -sum_at_nodes(other.rubs, theirs.lam, other.n)[:, contact.nodes]),
        "pressure": (contact.pressure, across[:, contact.nodes, 1] / floor.lengths[at]),
        "energy": (mine.energy, theirs.energy),
        "work": (mine.work, theirs.work),
        "dissipated": (mine.dissipated, theirs.dissipated),
    }
    found = {name: relative_difference(one, two, np.abs(two).max(initial=0.0)) for name, (one, two) in pairs.items()}
    most = np.abs(theirs.forces).sum(axis=1).max()
    for side in ("left", "right", "bottom", "top"):
        one, two = (result.forces[:, other.nodes(side)].sum(axis=1) for result in (mine, theirs))
        found[f"forces {side}"] = relative_difference(one, two, most)
    return found, theirs


def relative_difference(one, two, size):
    return np.abs(one - two).max(initial=0.0) / (size if size > 0 else 1.0)


def assert_agreement(name, n, times):
    mesh = vx.meshes.triangles(n)
    hard = np.abs(mesh.centroids[:, 0] - 0.5) < 0.25
    mesh = mesh.with_cell_data("hard", hard.astype(float)).with_cell_data("soft", (~hard).astype(float))
    parts, other = SCENES[name](mesh), Body(np.array(mesh.points), np.array(mesh.cells))
    for _, add in parts:
        add(other)
    found, theirs = compare(vx.Scene(*(effect for effect, _ in parts)), other, mesh, times)
    assert {quantity: error for quantity, error in found.items() if not error <= AGREE} == {}
    # The set of slipping rows must change, and some node must touch an obstacle.
    assert not other.rubs or len({tuple(row) for row in theirs.slipping}) > 1
    assert not other.obstacles or theirs.touching.any()


@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@pytest.mark.parametrize("name", [name for name in SCENES if name not in SLOW])
def test_scenes_agree_with_independent_programs(name):
    assert_agreement(name, 4, TIMES)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::vemcvx.SceneWarning")
@pytest.mark.parametrize("name", SCENES)
def test_scenes_agree_on_a_finer_mesh_in_more_steps(name):
    assert_agreement(name, 9, np.linspace(0, 1.2, 13))
