"""A stabilisation of one's own: patch test, order, and one a^h in the stiffness, the budget and the nodal distance."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scenes import mostly_long, small

import stabilisations_of_ones_own as own
import vemcvx as vx
from vemcvx.estimate.residual import CONSTANT
from vemcvx.scene import pose_scene

OWN = [own.Boundary(), own.DRecipe(), own.DRecipe(deviatoric=True)]
IDS = ["boundary", "D-recipe", "deviatoric"]
YOUNG, POISSON = 200.0, 0.3
LAM, MU = YOUNG * POISSON / (1.3 * 0.4), YOUNG / 2.6


def bar(stabilisation, mesh):
    """Pulled and sheared at its right end, held at its left one."""
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON, stabilisation=stabilisation),
        vx.Clamp(on="left"),
        vx.Traction((0.3, 0.1), on="right"),
    )
    return vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")


@mostly_long("stabilisation", OWN, ids=IDS)
def test_patch(stabilisation):
    for family in ("squares", "voronoi", "nonconvex", "triangles"):
        assert own.patch_error(stabilisation, small(family, 2)) < 1e-12


@pytest.mark.long
@pytest.mark.parametrize("stabilisation", OWN, ids=IDS)
def test_order_one(stabilisation):
    """Measured .97 to 1.05 between h = 1/4 and 1/16; the default has 1.05."""
    for family in ("voronoi", "hexagons"):
        slope = vx.measures.orders([1 / 4, 1 / 8, 1 / 16], own.errors(stabilisation, family)).slope
        assert 0.94 < slope < 1.1


@pytest.mark.long
def test_the_diagonal_with_the_volume_locks():
    """At nu = .49999: a third more of error and growing, where the deviatoric part alone has the default's."""
    default, locked, free = (
        own.errors(one, "voronoi", (8,), 0.49999)[0] for one in ("shear", own.DRecipe(), own.DRecipe(deviatoric=True))
    )
    assert locked > 1.3 * default
    assert free == pytest.approx(default, rel=0.02)


def test_on_a_square_by_hand():
    """The hourglass (1, -1, 1, -1): 8 mu of the boundary form, 4 max(mu, (lam + 3 mu) / 4) of the D-recipe."""
    mesh = vx.PolygonMesh([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]], [[0, 1, 2, 3]])
    u = np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
    for stabilisation, energy in ((OWN[0], 8 * MU), (OWN[1], LAM + 3 * MU), (OWN[2], 4 * MU), ("shear", 8 * MU)):
        posed = pose_scene(
            vx.Scene(vx.Elasticity(YOUNG, POISSON, stabilisation=stabilisation), vx.Clamp(on="boundary")), mesh
        )
        assert u.ravel() @ (posed.A @ u.ravel()) == pytest.approx(energy, rel=1e-13)
        assert posed.material.stabilisation_energies(posed.space, u).sum() == pytest.approx(energy, rel=1e-13)


def in_two(west, east):
    """A mesh of two materials, and these."""
    mesh = small("voronoi", 4)
    one = (mesh.centroids[:, 0] < 0.5).astype(float)
    mesh = mesh.with_cell_data("west", one).with_cell_data("east", 1.0 - one)
    return mesh, [dataclasses.replace(material, on=on) for material, on in ((west, "west"), (east, "east"))]


WOOD = vx.Orthotropic(young=(1000.0, 10.0), poisson=0.3, shear=2.0, angle=0.3, stabilisation=own.Boundary())
STEEL = vx.Elasticity(YOUNG, POISSON, plane="stress", stabilisation="unit")


@mostly_long(
    "west, east",
    [("unit", own.Boundary()), ("shear", "unit"), *((west, "unit") for west in OWN), (own.DRecipe(), own.Boundary())],
)
def test_one_form_of_the_stiffness_the_budget_and_the_nodal_distance(west, east):
    """|w|^2_{a^h} = w'Aw: of the nodal distance as it is, of the budget with what projected strains store."""
    west, east = dataclasses.replace(STEEL, stabilisation=west), dataclasses.replace(WOOD, stabilisation=east)
    mesh, materials = in_two(west, east)
    scene = vx.Scene(*materials, vx.Clamp(on="left"), vx.Traction((0.3, 0.1), on="right"))
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    A = pose_scene(scene, mesh).A
    w = np.random.default_rng(0).normal(size=mesh.points.shape)
    other = dataclasses.replace(history, displacement=history.displacement + w)
    apart = vx.measures.energy_distance(other, history, kind="nodal").absolute
    assert apart**2 == pytest.approx(w.ravel() @ (A @ w.ravel()), rel=1e-12)
    vx.error_budget(history)  # which compares the two energies itself


def written_and_read(history, folder):
    return vx.read_history(history.write(folder))


@pytest.mark.long
def test_files_keep_the_weights_and_know_no_classes(tmp_path):
    mesh = small("voronoi", 3)
    for name in ("shear", "unit"):
        history = bar(name, mesh)
        back = written_and_read(history, tmp_path / name)
        moved = dataclasses.replace(history, displacement=1.1 * history.displacement)
        apart = vx.measures.energy_distance(moved, history, kind="nodal").absolute
        moved = dataclasses.replace(back, displacement=1.1 * back.displacement)
        assert vx.measures.energy_distance(moved, back, kind="nodal").absolute == apart
    history = bar(own.Boundary(), mesh)
    back = written_and_read(history, tmp_path / "own")
    with pytest.raises(vx.HistoryError, match=r"without its stabilisation.*Field\(mesh, displacement, moduli, stab"):
        vx.measures.energy_distance(back, history, kind="nodal")
    field = vx.measures.Field(back.mesh, 1.1 * back.displacement[-1], back.moduli, stabilisation=own.Boundary())
    expected = 0.1 * np.sqrt(2 * history.energy[-1])
    assert vx.measures.energy_distance(field, history, kind="nodal").absolute == pytest.approx(expected, rel=1e-12)


class Softer(vx.Elasticity):
    """A law whose stiffness is of another form than its material says."""

    def contribute(self, space):
        ours = super().contribute(space)
        unit = vx.Elasticity(self.young, self.poisson, stabilisation="unit").contribute(space).material
        return dataclasses.replace(ours, stiffness=unit.stiffness(space).whole())


@pytest.mark.long
def test_a_budget_of_another_form_is_refused():
    """It was silent: an estimate with the stabilisation of the material, whatever the stiffness had."""
    scene = vx.Scene(Softer(YOUNG, POISSON), vx.Clamp(on="left"), vx.Traction((0.3, 0.1), on="right"))
    history = vx.simulate(scene, small("voronoi", 3), [0.0, 1.0], initial="settled")
    with pytest.raises(vx.SceneError, match=r"has the energy .*by the moduli .*must agree"):
        vx.error_budget(history)
    triangles = vx.simulate(scene, vx.meshes.triangles(3), [0.0, 1.0], initial="settled")
    vx.error_budget(triangles)  # on which Pi v = v, and the two forms are one


# The budget by hand, cell by cell and edge by edge, from the formulas of its module alone.


def projection(x):
    """G (n, 2) and Pi (n, n) in vertex values: the mean gradient by Gauss' theorem, the mean over the outline."""
    n, after, before = len(x), np.roll(x, -1, axis=0), np.roll(x, 1, axis=0)
    turned = 0.5 * (after - before)
    gradient = np.column_stack([turned[:, 1], -turned[:, 0]])
    area = 0.5 * np.sum(x[:, 0] * after[:, 1] - x[:, 1] * after[:, 0])
    length = np.linalg.norm(after - x, axis=1)
    weight = 0.5 * (length + np.roll(length, 1)) / length.sum()
    about = x - weight @ x
    return gradient / area, np.ones((n, 1)) * weight + about @ (gradient / area).T


FACTOR = 0.5


def boundary_form(x):
    length = np.linalg.norm(np.roll(x, -1, axis=0) - x, axis=1)
    S = np.zeros((len(x), len(x)))
    for e, one in enumerate(length):
        step = np.zeros(len(x))
        step[e], step[(e + 1) % len(x)] = -1.0, 1.0
        S += FACTOR * MU * length.mean() / one * np.outer(step, step)
    return S


def width(x, n):
    along = x @ n
    return along.max() - along.min()


def squares_by_hand(history):
    """The squares of "jumps", "boundary" and "stabilisation" over all cells, without the constant c^2."""
    mesh, u, stress, sides, stabilised, felt = history.mesh, history.displacement[-1], [], {}, 0.0, 0
    C = np.diag([2 * MU, 2 * MU, MU]) + LAM * np.outer([1, 1, 0], [1, 1, 0])
    for k, cell in enumerate(mesh.cells):
        x, v = mesh.points[cell], u[cell]
        G, Pi = projection(x)
        slope = v.T @ G
        strain = np.array([slope[0, 0], slope[1, 1], slope[0, 1] + slope[1, 0]])
        sigma = C @ strain
        stress.append(np.array([[sigma[0], sigma[2]], [sigma[2], sigma[1]]]))
        missed = v - Pi @ v
        S, along = np.einsum("ia,ij,ja->", missed, boundary_form(x), missed), 0.0
        for i, j in zip(cell, np.roll(cell, -1), strict=True):
            edge = mesh.points[j] - mesh.points[i]
            length, t = np.linalg.norm(edge), edge / np.linalg.norm(edge)
            normal = np.array([t[1], -t[0]])
            dyad = np.array([t[0] ** 2, t[1] ** 2, t[0] * t[1]])
            young = 1.0 / (dyad @ np.linalg.inv(C) @ dyad)
            apart = (u[j] - u[i]) @ t / length - dyad @ strain
            along += width(x, normal) * young / 6.0 * apart**2 * length
            sides.setdefault(frozenset((i, j)), []).append((k, normal, length, width(x, normal)))
        stabilised, felt = stabilised + max(S, along), felt + (along < S)
    jumps = boundary = 0.0
    for ends, both in sides.items():
        middle, (k, normal, length, d) = mesh.points[list(ends)].mean(axis=0), both[0]
        if len(both) == 2:
            (other, _, _, e) = both[1]
            jump = (stress[k] - stress[other]) @ normal
            jumps += 0.5 * (d + e) / (4 * MU) * jump @ jump * length
        elif middle[0] > 1e-9:  # the left side is clamped
            load = np.array([0.3, 0.1]) if middle[0] > 1 - 1e-9 else np.zeros(2)
            rest = load - stress[k] @ normal
            boundary += d / (2 * MU) * rest @ rest * length
    return {"jumps": jumps, "boundary": boundary, "stabilisation": stabilised, "felt": felt}


def test_the_budget_by_hand():
    """Of the boundary form, which is felt: in the larger of two parts it is that one."""
    history = bar(own.Boundary(FACTOR), small("voronoi", 4))
    budget, by_hand = vx.error_budget(history, -1), squares_by_hand(history)
    squares = {name: (part[0] * budget.scale) ** 2 for name, part in budget.parts.items()}
    assert squares["stabilisation"] == pytest.approx(by_hand["stabilisation"], rel=1e-10)
    assert squares["jumps"] == pytest.approx(CONSTANT**2 * by_hand["jumps"], rel=1e-10)
    assert squares["boundary"] == pytest.approx(CONSTANT**2 * by_hand["boundary"], rel=1e-10)
    assert squares["volume"] == squares["data"] == 0.0
    whole = CONSTANT**2 * (by_hand["jumps"] + by_hand["boundary"]) + by_hand["stabilisation"]
    assert (budget.space[0] * budget.scale) ** 2 == pytest.approx(whole, rel=1e-10)
    assert by_hand["felt"] > 0  # cells in which S_K is the larger of the two: all 16


@pytest.mark.long
@pytest.mark.parametrize("stabilisation", ["shear", "unit", *OWN], ids=["shear", "unit", *IDS])
def test_bounds_hold_whatever_the_stabilisation(stabilisation):
    """They are in a itself: intervals of the energy and of what is minimised meet those of a finer mesh."""
    fine = vx.error_bound(bar("shear", vx.meshes.squares(16)), step=1)
    bound = vx.error_bound(bar(stabilisation, small("voronoi", 4)), step=1)
    for (low, high), (least, most) in ((bound.energy, fine.energy), (bound.potential, fine.potential)):
        assert low < most
        assert least < high
    assert 0 < bound.lower < bound.upper


class Wrong(vx.Stabilisation):
    """A form that is none, in ways by name."""

    def __init__(self, way):
        self.way = way

    def form(self, cells, C):
        c, n = cells.nodes.shape
        S = np.tile(MU * np.eye(n), (c, 1, 1))
        if self.way == "skew":
            S[:, 0, 1] = MU
        if self.way == "indefinite":
            S[:, 0, 0] = -10 * MU
        if self.way == "nothing":
            S[:] = 0.0
        if self.way == "NaN":
            S[:, 0, 0] = np.nan
        if self.way == "fails":
            raise KeyError("no such cell")
        return {"shape": S[:, :2], "words": "none"}.get(self.way, S)


def test_wrong_forms():
    for way, words in (
        ("skew", "found a form of a cell with 4 vertices that differs from its transpose by"),
        ("indefinite", "found a cell with 4 vertices where some v - Pi v has the energy -"),
        ("nothing", "found a cell with 4 vertices where some v - Pi v has no energy"),
        ("NaN", "found NaN or infinity in the form of a cell with 4 vertices"),
        ("shape", r"found a form of shape \(1, 2, 4\) for 1 cells with 4 vertices"),
        ("words", "form: found 'none'"),
        ("fails", "its form failed when called with cells of 4 vertices: KeyError: 'no such cell'"),
    ):
        scene = vx.Scene(vx.Elasticity(YOUNG, POISSON, stabilisation=Wrong(way)), vx.Clamp(on="left"))
        with pytest.raises(vx.SceneError, match=f"Wrong: {words}"):
            pose_scene(scene, vx.meshes.squares(2))


def test_a_scene_says_it():
    scene = vx.Scene(vx.Elasticity(YOUNG, POISSON, stabilisation=own.Boundary()), WOOD)
    said = [effect.describe() for effect in scene]
    assert "Boundary stabilisation" in said[0]
    assert "Boundary stabilisation" in said[1]
    with pytest.raises(vx.SceneError, match="'shear'"):
        bar("trace", vx.meshes.squares(2))
    with pytest.raises(vx.HistoryError, match="stabilisation"):
        vx.measures.Field(vx.meshes.squares(2), np.zeros((9, 2)), np.ones((2, 4)), stabilisation="trace")


class Springs(vx.Stabilisation):
    """In space: mu h_K for every component at every vertex, half of the default."""

    def form(self, cells, C):
        weights = C[:, 3, 3] * cells.stabilised_size
        return weights[:, None, None] * np.eye(cells.nodes.shape[1])


@pytest.mark.long
@pytest.mark.parametrize("family", ["prisms", "cubes", "voronoi3"])
def test_in_space(family):
    """Patch test, and one form: half of the default's energy of what Pi misses, and w'Aw."""
    mesh = vx.meshes.SPACE_FAMILIES[family](2)

    def linear(x, t):
        return 1e-3 * t * x @ [[0.3, 0.1, 0.0], [0.2, -0.4, 0.1], [0.0, 0.5, 0.2]]

    material = vx.Elasticity(YOUNG, POISSON, stabilisation=Springs())
    pinned = vx.simulate(vx.Scene(material, vx.PrescribedDisplacement(linear, on="boundary")), mesh, [0.0, 1.0])
    np.testing.assert_allclose(pinned.displacement[-1], linear(mesh.points, 1.0), atol=1e-15)
    scene = vx.Scene(material, vx.Clamp(on="left"), vx.Traction((0.3, 0.1, 0.0), on="right"))
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    vx.error_budget(history)
    posed, w = pose_scene(scene, mesh), np.random.default_rng(0).normal(size=mesh.points.shape)
    default = pose_scene(scene.without(vx.Elasticity).with_(vx.Elasticity(YOUNG, POISSON)), mesh).material
    own, usual = (one.stabilisation_energies(posed.space, w) for one in (posed.material, default))
    np.testing.assert_allclose(own, 0.5 * usual, rtol=1e-12)
    moved = dataclasses.replace(history, displacement=history.displacement + w)
    apart = vx.measures.energy_distance(moved, history, kind="nodal").absolute
    assert apart**2 == pytest.approx(w.ravel() @ (posed.A @ w.ravel()), rel=1e-12)
