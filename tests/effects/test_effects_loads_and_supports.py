"""Pressure, Symmetry, PointLoad, ElasticFoundation: uniform states that every mesh reproduces, in closed form."""

from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import few_families, mostly_long, moved, rotation, small

import vemcvx as vx
from vemcvx.effects import Contribution, Support
from vemcvx.scene import pose_scene
from vemcvx.vem import Space

YOUNG, POISSON = 200.0, 0.3
STEEL = vx.Elasticity(YOUNG, POISSON, plane="stress")
MU = YOUNG / (2 * (1 + POISSON))
ROUND = 1e-11
BOX = ((0.0, 2.0), (0.0, 1.0))
LENGTH, HEIGHT = 2.0, 1.0


@dataclass(frozen=True)
class Pin(vx.Effect):
    """Hold components of a node."""

    node: int
    components: tuple[int, ...] = (0, 1)

    def contribute(self, space):
        nodes = np.full(len(self.components), self.node)
        directions = np.eye(2)[list(self.components)]
        return Contribution(supports=(Support("Pin", nodes, directions, space.mesh.points[nodes]),))

    def describe(self):
        return f"Pin: node {self.node}"


def turned(mesh, degrees):
    """The mesh turned about the origin, its boundaries with it, and the rotation."""
    R = rotation(np.radians(degrees))
    return moved(mesh, R), R


def tensor(rows):
    """Rows (xx, yy, xy) as matrices."""
    return np.array([[[xx, xy], [xy, yy]] for xx, yy, xy in rows])


def settled(*effects, mesh):
    return vx.simulate(vx.Scene(*effects), mesh, [0.0, 1.0], initial="settled")


def near(found, exact, scale):
    return np.abs(np.asarray(found) - exact).max() < ROUND * scale


@pytest.mark.parametrize("degrees", [0.0, 33.0])
def test_a_pressure_is_the_traction_along_the_inward_normal(family, degrees):
    """Affine on edges, both are exact: the nodal loads are (2 p_a + p_b) |e| / 6 along the edge's own normal."""
    mesh, _ = turned(small(family, 3), degrees)

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


def test_rollers_contradict_what_leaves_them():
    moved = vx.PrescribedDisplacement((0.0, 1e-3), on="left")
    with pytest.raises(
        vx.SceneError,
        match=r"^Symmetry on bottom: node 0 at \[0\. 0\.\] is to move by 0 along \[ ?0\. -1\.\] at t = 0, but other "
        r"supports already move it by -0\.001\.$",
    ):
        settled(STEEL, moved, vx.Symmetry(on="bottom"), mesh=small("squares", 3))


@pytest.mark.parametrize("many", [False, True])
def test_forces_on_the_two_ends_of_an_edge_are_its_traction(many):
    """One cell high, F / 2 on both corners of the end is the uniform traction F / H: u_x = F x / (E H)."""
    mesh = vx.meshes.squares((6, 1), box=BOX)
    corners = [(LENGTH, 0.0), (LENGTH, HEIGHT)]
    force = 8.0
    half = (force / 2, 0.0)
    loads = [vx.PointLoad([half, half], at=corners)] if many else [vx.PointLoad(half, at=x) for x in corners]
    history = settled(STEEL, vx.Symmetry(on=["left", "bottom"]), *loads, mesh=mesh)
    strain = force / HEIGHT / YOUNG
    assert near(history.displacement[-1], strain * mesh.points * [1.0, -POISSON], strain * LENGTH)
    assert near(history.stress(-1), [force / HEIGHT, 0.0, 0.0], force)
    assert near(history.reaction("left")[-1], [-force, 0.0], force)
    assert history.energy[-1] == pytest.approx(0.5 * force * strain * LENGTH, rel=1e-11)


@pytest.mark.long
def test_the_energy_of_a_point_force_grows_with_every_refinement():
    """Like log(1/h): halving h adds F^2 (1 / (pi E)) log 2 to 2 x energy (Flamant), within a few per cent."""
    energies = []
    for n in (16, 32, 64):
        mesh = vx.meshes.squares(n)
        history = settled(STEEL, vx.Clamp(on="bottom"), vx.PointLoad((0.0, -1.0), at=(0.5, 1.0)), mesh=mesh)
        energies.append(history.energy[-1])
    growth = np.diff(energies)
    # Under a normal force F the surface sinks by 2 F / (pi E) log(1 / r): the energy 1/2 F u by F^2 / (pi E) log 2.
    assert growth == pytest.approx(np.log(2) / (np.pi * YOUNG), rel=0.05)


@few_families
@mostly_long("degrees", [0.0, 33.0], 1)
@mostly_long("k", [0.1, 40.0, 1e6], 0, 2)
def test_springs_alone_hold_a_body(family, degrees, k):
    """Pressed and sheared on its springs: sigma = (0, -p, s), u = (s / kt + s y / mu, -p / kn - p y / E)."""
    mesh, R = turned(small(family, 3, box=BOX), degrees)
    p, s, kn, kt = 2.0, 0.5, k, 0.5 * k

    def across(sign):
        return lambda x, t: np.tile(R @ [0.0, sign * s], (len(x), 1))

    history = settled(
        vx.Elasticity(YOUNG, 0.0, plane="stress"),
        vx.ElasticFoundation(normal=kn, tangential=kt, on="bottom"),
        vx.Pressure(p, on="top"),
        vx.Traction(tuple(R @ [s, 0.0]), on="top"),
        vx.Traction(across(1.0), on="right"),
        vx.Traction(across(-1.0), on="left"),
        mesh=mesh,
    )
    y = (mesh.points @ R)[:, 1]
    exact = np.column_stack([s / kt + s * y / (YOUNG / 2), -p / kn - p * y / YOUNG])
    # The condition of the matrix grows like E / k with softer springs.
    worse = max(1.0, YOUNG / k)
    assert near(history.displacement[-1] @ R, exact, worse * np.abs(exact).max())
    assert near(R.T @ tensor(history.stress(-1)) @ R, [[0.0, s], [s, -p]], worse * p)
    springs = p**2 / kn + s**2 / kt
    body = p**2 / YOUNG + s**2 / (YOUNG / 2)
    assert history.energy[-1] == pytest.approx(0.5 * LENGTH * (springs + HEIGHT * body), rel=1e-9)
    # Springs are part of the body: there is no reaction.
    assert near(history.reaction("boundary"), 0.0, worse * p)


def test_the_springs_matrix_is_the_mass_matrix_of_the_edges(family):
    """For k affine along the boundary: int k (u . n)^2 ds of an affine u, by Simpson (cubic), symmetric to the bit."""
    mesh, _ = turned(small(family, 3), 20.0)

    def k(x):
        return 2.0 + x[:, 0] + 0.5 * x[:, 1]

    F = vx.ElasticFoundation(normal=k, tangential=lambda x: 3 * k(x), on="boundary").contribute(Space(mesh)).stiffness
    assert (F != F.T).nnz == 0
    rng = np.random.default_rng(0)
    u = rng.standard_normal(mesh.points.shape)
    exact = 0.0
    for a, b in mesh.boundaries["boundary"]:
        chord = mesh.points[b] - mesh.points[a]
        length = np.linalg.norm(chord)
        normal, tangent = np.array([chord[1], -chord[0]]) / length, chord / length
        ends = mesh.points[[a, b]]
        for at, v, weight in ((ends[0], u[a], 1), (ends.mean(axis=0), (u[a] + u[b]) / 2, 4), (ends[1], u[b], 1)):
            exact += length / 6 * weight * k(at[None])[0] * ((v @ normal) ** 2 + 3 * (v @ tangent) ** 2)
    assert u.ravel() @ (F @ u.ravel()) == pytest.approx(exact, rel=1e-13)


def test_friction_holds_what_springs_leave_free():
    """A block on normal springs, rubbing: it bears |traction| below the bound without moving, and sinks by p / kn."""
    mesh = vx.meshes.squares(3)
    p, s, kn = 2.0, 0.3, 50.0
    loads = [
        vx.Pressure(lambda x, t: p * t, on="top"),
        vx.Traction(lambda x, t: [s * t, 0.0], on="top"),
        vx.Traction(lambda x, t: [0.0, s * t], on="right"),
        vx.Traction(lambda x, t: [0.0, -s * t], on="left"),
    ]
    rough = [vx.ElasticFoundation(normal=kn, on="bottom"), vx.TrescaFriction(1.0, on="bottom")]
    with pytest.warns(vx.SceneWarning, match="nothing but friction or one-sided contact holds the body"):
        history = vx.simulate(vx.Scene(vx.Elasticity(YOUNG, 0.0), *rough, *loads), mesh, [0.0, 0.5, 1.0])
    assert history.contact.sticking.all()
    y = mesh.points[:, 1]
    exact = np.column_stack([s * y / (YOUNG / 2), -p / kn - p * y / YOUNG])
    assert np.abs(history.displacement[-1] - exact).max() < 1e-9
    assert np.abs(history.contact.traction[-1] - [-s, 0.0]).max() < 1e-8


@dataclass(frozen=True)
class Links(vx.Effect):
    """Springs of stiffness one between pairs of nodes: an effect of one's own, which holds nothing to the ground."""

    pairs: tuple[tuple[int, int], ...]

    def contribute(self, space):
        rows = np.zeros((2 * len(self.pairs), space.n_unknowns))
        for i, (a, b) in enumerate(self.pairs):
            for axis in (0, 1):
                rows[2 * i + axis, [2 * a + axis, 2 * b + axis]] = 1.0, -1.0
        return Contribution(stiffness=sp.csr_matrix(rows.T @ rows))

    def describe(self):
        return "Links: springs"


def test_what_springs_do_not_feel_floats():
    """Springs hold what they touch along what they feel; links between pieces hold these to each other only."""
    one = vx.meshes.squares(3)
    points = [[0, 0], [1, 0], [1, 1], [0, 1], [3, 0], [4, 0], [4, 1], [3, 1]]
    two = vx.PolygonMesh(np.array(points, dtype=float), [[0, 1, 2, 3], [4, 5, 6, 7]])
    two = two.with_boundary("first", lambda x: x[:, 0] < 0.1).with_boundary("second", lambda x: x[:, 0] > 3.9)
    first, second = (vx.ElasticFoundation(7.0, 7.0, on=on) for on in ("first", "second"))
    links = Links(((1, 4), (2, 7)))
    for mesh, effect, says in (
        (one, vx.ElasticFoundation(normal=10.0, on="bottom"), r"1 rigid motion meets .* the translation \(1, 0\)"),
        (two, first, "part 2 of 2 of the body floats: 3 rigid motions"),
        (two, links, "3 rigid motions .* a motion of several connected pieces"),
    ):
        with pytest.raises(vx.SceneError, match=f"^supports: .*{says}"):
            pose_scene(vx.Scene(STEEL, effect), mesh)
    for nothing in (0.0, lambda x: 0 * x[:, 0]):
        assert pose_scene(vx.Scene(STEEL, vx.ElasticFoundation(normal=nothing, on="boundary")), one).pins
    for mesh, held in (
        (one, [vx.ElasticFoundation(normal=10.0, on=["bottom", "left"])]),
        (two, [first, second]),
        (two, [links, vx.Clamp("first")]),
    ):
        posed = pose_scene(vx.Scene(STEEL, *held), mesh)
        assert posed.system.kernel is None
        assert np.linalg.eigvalsh(posed.system.K.toarray())[0] > 1e-3


@pytest.mark.long
def test_loads_and_strains_in_some_cells_alone():
    """Two bars side by side, of which one is pulled, warms or is stressed: the other does not feel it."""
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
    with pytest.raises(vx.SceneError, match="^BodyForce: on= names cells by a cell datum"):
        vx.simulate(vx.Scene(*held, vx.BodyForce((0.0, 3.0), on="three")), mesh, [0.0, 1.0])


@pytest.mark.long
def test_bounds_and_estimates_read_a_body_force_on_some_cells():
    """A force on the right half, which begins at an edge of cells, is that of a function which jumps there."""
    mesh = vx.meshes.squares(4)
    mesh = mesh.with_cell_data("half", 1.0 * (mesh.centroids[:, 0] > 0.5))
    held = vx.Elasticity(100.0, 0.3), vx.Clamp(on="left")
    on_cells, by_place = (
        vx.simulate(vx.Scene(*held, force), mesh, [0.0, 1.0], initial="settled")
        for force in (
            vx.BodyForce(lambda x, t: (0.0 * x[:, 0] + [[0.0], [-1.0]]).T, on="half"),
            vx.BodyForce(lambda x, t: np.column_stack([0 * x[:, 0], -1.0 * (x[:, 0] > 0.5)])),
        )
    )
    assert on_cells.energy[-1] == pytest.approx(by_place.energy[-1], rel=1e-12)
    one, other = (vx.error_bound(history, 1) for history in (on_cells, by_place))
    assert (one.lower, one.upper) == pytest.approx((other.lower, other.upper), rel=1e-9)
    one, other = (vx.error_budget(history) for history in (on_cells, by_place))
    assert one.largest["space"] == pytest.approx(other.largest["space"], rel=1e-9)
