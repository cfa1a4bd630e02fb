"""Pressure, Symmetry, PointLoad, ElasticFoundation: uniform states in closed form."""

from dataclasses import dataclass

import numpy as np
import pytest
from scenes import moved, rotation, small

import vemcvx as vx
from vemcvx.effects import Contribution, Support
from vemcvx.scene import pose_scene
from vemcvx.vem import Space

YOUNG, POISSON = 200.0, 0.3
STEEL = vx.Elasticity(YOUNG, POISSON, plane="stress")
ROUND = 1e-11
BOX = ((0.0, 2.0), (0.0, 1.0))
LENGTH, HEIGHT = 2.0, 1.0


@dataclass(frozen=True)
class Pin(vx.Effect):
    """A support that fixes components of one node."""

    node: int
    components: tuple[int, ...] = (0, 1)

    def contribute(self, space):
        nodes = np.full(len(self.components), self.node)
        directions = np.eye(2)[list(self.components)]
        return Contribution(supports=(Support("Pin", nodes, directions, space.mesh.points[nodes]),))

    def describe(self):
        return f"Pin: node {self.node}"


def rotate(mesh, degrees):
    """Return the rotated mesh and the rotation."""
    R = rotation(np.radians(degrees))
    return moved(mesh, R), R


def settled(*effects, mesh):
    return vx.simulate(vx.Scene(*effects), mesh, [0.0, 1.0], initial="settled")


def is_near(found, exact, scale):
    return np.abs(np.asarray(found) - exact).max() < ROUND * scale


@pytest.mark.parametrize("degrees", [0.0, 33.0])
def test_a_pressure_is_the_traction_along_the_inward_normal(family, degrees):
    """An affine pressure on an edge e from a to b causes the force (2 p_a + p_b) |e| / 6 at a."""
    mesh, _ = rotate(small(family, 3), degrees)

    def p(x, t):
        return t * (1.0 + 2.0 * x[:, 0] - 0.7 * x[:, 1])

    found = vx.Pressure(p, on="boundary").contribute(Space(mesh)).loads[0].vector(2.0).reshape(-1, 2)
    exact = np.zeros_like(found)
    for a, b in mesh.boundaries["boundary"]:
        chord = mesh.points[b] - mesh.points[a]
        outward = np.array([chord[1], -chord[0]])
        pa, pb = p(mesh.points[[a, b]], 2.0)
        exact[a] -= (2 * pa + pb) / 6 * outward
        exact[b] -= (pa + 2 * pb) / 6 * outward
    assert np.abs(found - exact).max() < 1e-14


@pytest.mark.parametrize("many", [False, True])
def test_forces_on_the_two_ends_of_an_edge_are_its_traction(many):
    """Two forces F / 2 at the corners of a side of height H act like the traction F / H: u_x = F x / (E H)."""
    mesh = vx.meshes.squares((6, 1), box=BOX)
    corners = [(LENGTH, 0.0), (LENGTH, HEIGHT)]
    force = 8.0
    half = (force / 2, 0.0)
    loads = [vx.PointLoad([half, half], at=corners)] if many else [vx.PointLoad(half, at=x) for x in corners]
    history = settled(STEEL, vx.Symmetry(on=["left", "bottom"]), *loads, mesh=mesh)
    strain = force / HEIGHT / YOUNG
    assert is_near(history.displacement[-1], strain * mesh.points * [1.0, -POISSON], strain * LENGTH)
    assert is_near(history.stress(-1), [force / HEIGHT, 0.0, 0.0], force)
    assert is_near(history.reaction("left")[-1], [-force, 0.0], force)
    assert history.energy[-1] == pytest.approx(0.5 * force * strain * LENGTH, rel=1e-11)


def test_springs_hold_only_the_motions_that_stretch_them():
    """Normal springs on a side do not prevent sliding along the side. Springs on one piece hold no other piece."""
    one = vx.meshes.squares(3)
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [3, 0], [4, 0], [4, 1], [3, 1]]
    two = vx.PolygonMesh(np.array(points, dtype=float), [[0, 1, 2, 3], [4, 5, 6, 7]])
    two = two.with_boundary("first", lambda x: x[:, 0] < 0.1).with_boundary("second", lambda x: x[:, 0] > 3.9)
    for mesh, springs, says in (
        (one, vx.ElasticFoundation(normal=10.0, on="bottom"), r"prevents 1 rigid motion: the translation \(1, 0\)"),
        (two, vx.ElasticFoundation(7.0, 7.0, on="first"), "part 2 of 2 of the body floats: .* 3 rigid motions"),
    ):
        with pytest.raises(vx.SceneError, match=f"^supports: .*{says}"):
            pose_scene(vx.Scene(STEEL, springs), mesh)
    for mesh, springs in (
        (one, vx.ElasticFoundation(normal=10.0, on=["bottom", "left"])),
        (two, vx.ElasticFoundation(7.0, 7.0, on=["first", "second"])),
    ):
        posed = pose_scene(vx.Scene(STEEL, springs), mesh)
        assert posed.system.kernel is None
        assert np.linalg.eigvalsh(posed.system.K.toarray())[0] > 1e-3


@pytest.mark.long
def test_loads_and_strains_act_in_their_own_cells_only():
    """One of two bars is loaded, heated or prestressed. The other bar does not move."""
    bars = {name: vx.meshes.voronoi((2, 4), box=((x, x + 1), (0, 2)), seed=1) for name, x in (("one", 0), ("two", 2))}
    mesh = vx.meshes.bodies(bars)
    held = (
        vx.Elasticity(100.0, 0.0),
        vx.Symmetry(on=["one.bottom", "two.bottom"]),
        vx.Symmetry(on=["one.left", "two.left"]),
    )
    ends = np.isclose(mesh.points[:, 1], 2) & (mesh.points[:, 0] < 1.5)
    for effect, wanted in (
        (vx.BodyForce((0.0, 3.0), on="one"), 3.0 * 2**2 / 2 / 100),
        (vx.ThermalStrain(1e-3, 5.0, on="one"), 5e-3 * 2),
        (vx.Prestress((0.0, -7.0, 0.0), on="one"), 0.07 * 2),
    ):
        history = vx.simulate(vx.Scene(*held, effect), mesh, [0.0, 1.0], initial="settled")
        assert history.displacement[-1][ends, 1].mean() == pytest.approx(wanted, rel=0.02)
        assert not history.displacement[-1][mesh.points[:, 0] > 1.5].any()
        assert "one" in history.effects[[type(effect).__name__ in words for words in history.effects].index(True)]
    total = vx.simulate(vx.Scene(*held, vx.BodyForce((0.0, 3.0), on="one")), mesh, [0.0, 1.0], initial="settled")
    assert total.force(vx.BodyForce)[-1] == pytest.approx([0.0, 6.0], abs=1e-12)
