"""Limit loads are compared with linear programs of statics, and with simulations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

import vemcvx as vx

STEEL = vx.Elasticity(2e4, 0.3)
FLOATS = pytest.mark.filterwarnings("ignore:.*one-sided contact holds the body")
GAP = 2e-9
"""Largest (found.upper - found.factor) / found.factor."""


def wrench(points, forces):
    """Return forces at points, and moments about the origin, as columns (6, m)."""
    x, f = (np.pad(each, ((0, 0), (0, 3 - each.shape[1]))) for each in np.broadcast_arrays(points, forces))
    return np.hstack([f, np.cross(x, f)]).T


def solve_statics(points, ways, dead, push, friction):
    """Solve a linear program for the largest factor of a push that a floor with friction can balance.

    `dead` and `push` are columns of :func:`wrench`. The factor multiplies `push`. At each point, the floor exerts an
    upward pressure p and the tangential force sum_k a_k ways_k, with a_k >= 0 and sum_k a_k <= `friction` p.
    """
    (m, dim), q = points.shape, len(ways)
    columns = [wrench(points, way) for way in (np.eye(dim)[-1], *ways)]
    bound = np.hstack([-friction * np.eye(m), *[np.eye(m)] * q, np.zeros((m, 1))])
    found = linprog(
        np.append(np.zeros(m + m * q), -1.0),
        A_ub=bound,
        b_ub=np.zeros(m),
        A_eq=np.hstack([*columns, push[:, None]]),
        b_eq=-dead,
        bounds=[(0, None)] * (m + m * q) + [(None, None)],
    )
    return -found.fun


def rest_on_floor(friction, *others):
    """Return the scene of a body on a floor with Coulomb's friction. The pressure 3 acts on the top."""
    floor = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(friction, on="bottom")
    return vx.Scene(STEEL, vx.Pressure(3.0, on="top"), *floor, *others)


@pytest.mark.parametrize(
    ("friction", "angle", "moves"),
    [
        (0.2, 0.3, "the translation (0.98, 0.2) of the body"),
        (1.5, -0.4, "with a clockwise rotation"),
        (0.7, 2.0, "with an anticlockwise rotation"),
    ],
)
def test_a_block_slides_or_tips_as_a_linear_program_of_statics_finds(friction, angle, moves):
    mesh = vx.meshes.hanging(4, box=((0.0, 2.0), (0.0, 1.0)), seed=3)
    way = np.array([[np.cos(angle), np.sin(angle)]])
    found = vx.limit_load(rest_on_floor(friction), mesh, vx.Traction(tuple(way[0]), on="right"))
    points, side = mesh.points[mesh.points[:, 1] == 0.0], np.array([[1.0, 0.0]])
    loads = wrench(np.array([[1.0, 1.0], [2.0, 0.5]]), np.vstack([[0.0, -6.0], way]))
    assert found.factor == pytest.approx(solve_statics(points, [*side, *-side], *loads.T, friction), rel=1e-8)
    assert moves in found.mechanism
    assert 0.0 <= found.upper - found.factor <= GAP * found.factor


@pytest.mark.parametrize("family", ["cubes", pytest.param("voronoi3", marks=pytest.mark.long)])
def test_the_factor_of_a_plate_pushed_at_its_edge_lies_between_two_linear_programs(family):
    """In the linear programs, inner or outer polygons replace the friction discs."""
    mesh = vx.meshes.SPACE_FAMILIES[family](3, box=((0.0, 2.0), (0.0, 1.0), (0.0, 0.5)))
    found = vx.limit_load(rest_on_floor(0.3), mesh, vx.Traction((0.0, 2.0, 0.5), on="right"))
    points = mesh.points[mesh.points[:, 2] < 1e-12]
    turns = 2 * np.pi * np.arange(48) / 48
    ways = np.column_stack([np.cos(turns), np.sin(turns), 0 * turns])
    loads = wrench(np.array([[1.0, 0.5, 0.5], [2.0, 0.5, 0.25]]), np.array([[0.0, 0.0, -6.0], [0.0, 1.0, 0.25]]))
    least = solve_statics(points, ways, *loads.T, 0.3)
    assert least <= found.upper
    assert found.factor <= solve_statics(points, ways / np.cos(np.pi / 48), *loads.T, 0.3)
    assert 0.0 <= found.upper - found.factor <= GAP * found.factor


class Pile:
    """Three blocks `a`, `b` and `c` in a pile, pressed from above. A force pushes one block at the left side."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)
        left, levels = rng.uniform(-0.3, 0.3, 3), np.append(0.0, np.cumsum(rng.uniform(0.4, 1.0, 3)))
        self.boxes = {name: ((left[i], left[i] + 1.5), tuple(levels[i : i + 2])) for i, name in enumerate("abc")}
        self.mesh = vx.meshes.bodies({name: vx.meshes.voronoi(3, box, seed) for name, box in self.boxes.items()})
        self.low, self.high = rng.uniform(0.2, 1.2, 2)
        scene = vx.Scene(
            STEEL,
            vx.Pressure(2.0, on="c.top"),
            vx.UnilateralContact(on=["a.bottom", "a|b", "b|c"]),
            vx.CoulombFriction(self.low, on="a.bottom"),
            vx.CoulombFriction(self.high, on="a|b"),
            vx.TrescaFriction(0.5, on="b|c", while_closed=False),
        )
        self.pushed, self.way = "abc"[rng.integers(3)], np.array([1.0, rng.uniform(-0.5, 0.5)])
        self.found = vx.limit_load(scene, self.mesh, vx.Traction(tuple(self.way), on=f"{self.pushed}.left"))
        self.size = np.abs(self.found.pressure).sum()

    def nodes(self, name):
        """Return the nodes of a block."""
        mesh = self.mesh
        return np.unique(mesh.vertices[np.repeat(mesh.cell_data[name] == 1, np.diff(mesh.offsets))])

    def mean_motion(self, name, corners):
        """Return the motion of the midpoint between two corners of a block."""
        own = self.nodes(name)
        apart = np.linalg.norm(self.mesh.points[own] - np.array(corners)[:, None], axis=2)
        return self.found.motion[own[apart.argmin(axis=1)]].mean(axis=0)


@pytest.mark.parametrize("seed", range(4))
def test_the_forces_found_balance_each_body_and_the_motion_found_gives_the_upper_bound(seed):
    pile = Pile(seed)
    found, mesh = pile.found, pile.mesh
    assert 0.0 <= found.upper - found.factor <= GAP * found.factor
    for name, ((x0, x1), (y0, y1)) in pile.boxes.items():
        loads = [[0.0, -3.0 * (name == "c")], found.factor * (y1 - y0) * pile.way * (name == pile.pushed)]
        at, own = np.array([[0.5 * (x0 + x1), y1], [x0, 0.5 * (y0 + y1)]]), pile.nodes(name)
        total = wrench(mesh.points[own], (found.friction + found.pressure)[own]).sum(axis=1)
        assert total + wrench(at, np.array(loads)).sum(axis=1) == pytest.approx(0.0, abs=1e-10 * pile.size)
    # Pressure acts downwards on the lower block of a joint, and upwards on block `a` at the floor.
    for nodes, friction, sign in (
        (pile.nodes("a")[mesh.points[pile.nodes("a"), 1] == 0.0], pile.low, 1.0),
        (mesh.interfaces["a|b"].pairs[:, 0], pile.high, -1.0),
    ):
        pressure = sign * found.pressure[nodes, 1]
        assert (pressure >= 0.0).all()
        assert (np.abs(found.friction[nodes, 0]) <= friction * pressure + 1e-11 * pile.size).all()

    # The computed motion is a mechanism.
    u, floor = found.motion, mesh.points[pile.nodes("a"), 1] == 0.0
    (x0, _), (y0, y1) = pile.boxes[pile.pushed]
    assert (y1 - y0) * pile.way @ pile.mean_motion(pile.pushed, [(x0, y0), (x0, y1)]) == pytest.approx(1.0, abs=1e-9)
    low = u[pile.nodes("a")[floor]]
    (one, other), (below, above) = (mesh.interfaces[name].pairs.T for name in ("a|b", "b|c"))
    middle, high = u[other] - u[one], u[above] - u[below]
    for lifted, friction in ((low, pile.low), (middle, pile.high), (high, 0.0)):
        assert (lifted[:, 1] - friction * np.abs(lifted[:, 0]) >= -1e-10 * np.abs(u).max()).all()
    along = np.argsort(mesh.points[below, 0])
    between = np.diff(mesh.points[below[along], 0])
    lengths = 0.5 * (np.append(between, 0.0) + np.append(0.0, between))
    (x0, x1), (_, y1) = pile.boxes["c"]
    lifted = 3.0 * pile.mean_motion("c", [(x0, y1), (x1, y1)])[1]
    assert 0.5 * lengths @ np.abs(high[along, 0]) + lifted == pytest.approx(found.upper, rel=1e-9)


@FLOATS
@pytest.mark.parametrize("law", ["Tresca", pytest.param("Coulomb", marks=pytest.mark.long)])
def test_steps_find_equilibrium_below_the_factor_but_not_above(law):
    """The block slides at the force 1.2."""
    mesh = vx.meshes.voronoi(4, box=((0.0, 2.0), (0.0, 1.0)))
    friction = vx.CoulombFriction(0.2, on="bottom")
    if law == "Tresca":
        friction = vx.TrescaFriction(0.6, on="bottom", while_closed=False)
    scene = vx.Scene(STEEL, vx.Pressure(3.0, on="top"), vx.UnilateralContact(on="bottom"), friction)
    found = vx.limit_load(scene, mesh, vx.Traction((1.0, 0.0), on="left"))
    assert found.factor == pytest.approx(1.2, rel=1e-8)

    def run(times):
        load = vx.Traction(lambda x, t: np.tile([found.factor * t, 0.0], (len(x), 1)), on="left")
        return vx.simulate(scene.with_(load), mesh, times, initial="settled")

    assert run([0.0, 0.5, 0.9, 0.999]).certified.max() < 1e-8
    with pytest.raises(vx.SceneError, match="there is no equilibrium"):
        run([0.0, 0.5, 0.9, 1.001])


def test_compliance_gaps_and_stiffness_do_not_matter():
    push = vx.Traction((1.0, 0.0), on="left")
    mesh, friction = vx.meshes.squares(3), vx.CoulombFriction(0.2, on="bottom")
    press = vx.Pressure(1.0, on="top")
    stiff = vx.limit_load(vx.Scene(STEEL, press, vx.UnilateralContact(on="bottom", gap=0.1), friction), mesh, push)
    contact = vx.NormalCompliance(1e3, on="bottom")
    soft = vx.limit_load(vx.Scene(vx.Elasticity(1.0, 0.0), press, contact, friction), mesh, push)
    assert soft.factor == pytest.approx(stiff.factor, rel=1e-8)
    assert stiff.factor == pytest.approx(0.2, rel=1e-8)


def test_contact_without_friction_has_a_limit_load():
    """Obstacles hold a block at three sides. The pressure 1 on the top resists upward forces."""
    mesh = vx.meshes.squares(2)
    contact = vx.UnilateralContact(on=["left", "right", "bottom"])
    found = vx.limit_load(
        vx.Scene(STEEL, contact, vx.Pressure(1.0, on="top")), mesh, vx.Traction((0.3, 2.0), on="right")
    )
    assert found.factor == pytest.approx(0.5, rel=1e-8)
    assert not found.friction.any()


class Glue(vx.TrescaFriction):
    """Friction that always sticks."""

    def contribute(self, space):
        parts = super().contribute(space)
        (friction,) = parts.frictions
        return replace(parts, frictions=(replace(friction, weights=lambda t: np.full(len(friction.nodes), np.inf)),))


def test_friction_that_always_sticks_is_refused():
    mesh, scene = vx.meshes.squares(2), vx.Scene(STEEL, vx.BilateralContact(on="bottom"), Glue(1.0, on="bottom"))
    pull = vx.Traction(lambda x, t: np.tile([t, 0.0], (len(x), 1)), on="left")
    with pytest.raises(vx.SceneError, match="found friction that always sticks"):
        vx.limit_load(scene, mesh, pull)
    with pytest.raises(vx.SceneError, match="found friction that always sticks"):
        vx.shakedown(scene.with_(pull), mesh, [0.0, 1.0])


def test_loads_are_summed_and_evaluated_at_the_instant():
    mesh, scene = vx.meshes.squares(2), rest_on_floor(0.2)
    ramp = vx.Traction(lambda x, t: np.tile([t, 0.0], (len(x), 1)), on="left")
    both = [ramp, vx.PointLoad((1.0, 0.0), at=(0.0, 0.0))]
    assert vx.limit_load(scene, mesh, ramp, t=2.0).factor == pytest.approx(0.3, rel=1e-8)
    assert vx.limit_load(scene, mesh, both, t=2.0).factor == pytest.approx(0.2, rel=1e-8)
