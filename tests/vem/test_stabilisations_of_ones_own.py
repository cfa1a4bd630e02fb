"""User-defined stabilisations: stiffness, error budget and nodal distance use the same form."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scenes import small

import stabilisations_of_ones_own as own
import vemcvx as vx
from vemcvx.estimate.residual import CONSTANT
from vemcvx.scene import pose_scene
from vemcvx.vem import strains

OWN = [own.Boundary(), own.DRecipe(), own.DRecipe(deviatoric=True)]
YOUNG, POISSON = 200.0, 0.3
LAM, MU = YOUNG * POISSON / (1.3 * 0.4), YOUNG / 2.6


def simulate_bar(stabilisation, mesh):
    """Simulate a bar that is pulled and sheared on the right, and held on the left."""
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON, stabilisation=stabilisation),
        vx.Clamp(on="left"),
        vx.Traction((0.3, 0.1), on="right"),
    )
    return vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")


def test_the_patch_test():
    for family in ("squares", "voronoi", "nonconvex", "triangles"):
        for stabilisation in OWN:
            assert own.patch_error(stabilisation, small(family, 2)) < 1e-12


@pytest.mark.long
def test_the_d_recipe_locks_unless_it_is_deviatoric():
    """At nu = .49999, `DRecipe()` has 2.7 times the default error. `DRecipe(deviatoric=True)` has the default error."""
    default, locked, free = (
        own.errors(one, "voronoi", (8,), 0.49999)[0] for one in ("shear", own.DRecipe(), own.DRecipe(deviatoric=True))
    )
    assert locked > 2.5 * default
    assert free == pytest.approx(default, rel=0.02)


def test_energies_of_the_hourglass_of_a_square():
    """The energy is 8 mu for `Boundary`, lam + 3 mu for `DRecipe()`, and 4 mu for `DRecipe(deviatoric=True)`."""
    mesh = vx.PolygonMesh([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]], [[0, 1, 2, 3]])
    u = np.array([[1.0, 0.0], [-1.0, 0.0], [1.0, 0.0], [-1.0, 0.0]])
    for stabilisation, energy in ((OWN[0], 8 * MU), (OWN[1], LAM + 3 * MU), (OWN[2], 4 * MU), ("shear", 8 * MU)):
        posed = pose_scene(
            vx.Scene(vx.Elasticity(YOUNG, POISSON, stabilisation=stabilisation), vx.Clamp(on="boundary")), mesh
        )
        assert u.ravel() @ (posed.A @ u.ravel()) == pytest.approx(energy, rel=1e-13)
        assert posed.material.stabilisation_energies(posed.space, u).sum() == pytest.approx(energy, rel=1e-13)


WOOD = vx.Orthotropic(young=(1000.0, 10.0), poisson=0.3, shear=2.0, angle=0.3, stabilisation=own.Boundary())
STEEL = vx.Elasticity(YOUNG, POISSON, plane="stress", stabilisation="unit")


def test_the_stiffness_the_budget_and_the_nodal_distance_have_the_same_form():
    """The squared nodal distance of two fields is w'Aw, with the difference w and the stiffness matrix A."""
    mesh = small("voronoi", 4)
    west = (mesh.centroids[:, 0] < 0.5).astype(float)
    mesh = mesh.with_cell_data("west", west).with_cell_data("east", 1.0 - west)
    w = np.random.default_rng(0).normal(size=mesh.points.shape)
    loaded = vx.Clamp(on="left"), vx.Traction((0.3, 0.1), on="right")
    two = dataclasses.replace(STEEL, on="west"), dataclasses.replace(WOOD, stabilisation="shear", on="east")
    for materials in (two, [WOOD]):
        scene = vx.Scene(*materials, *loaded)
        history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
        moved = dataclasses.replace(history, displacement=history.displacement + w)
        apart = vx.measures.energy_distance(moved, history, kind="nodal").absolute
        assert apart**2 == pytest.approx(w.ravel() @ (pose_scene(scene, mesh).A @ w.ravel()), rel=1e-12)
        vx.error_budget(history)
    with pytest.raises(vx.SceneError, match="^materials: a stabilisation of your own needs one material"):
        pose_scene(vx.Scene(two[0], dataclasses.replace(WOOD, on="east"), *loaded), mesh)


@pytest.mark.long
def test_files_keep_named_stabilisations_but_no_classes(tmp_path):
    mesh = small("voronoi", 3)
    for name in ("unit", own.Boundary()):
        history = simulate_bar(name, mesh)
        back = vx.read_history(history.write(tmp_path / str(name)))
        expected = 0.1 * np.sqrt(2 * history.energy[-1])
        if name != "unit":
            sentence = r"without its stabilisation.*Field\(mesh, displacement, moduli, stab"
            with pytest.raises(vx.HistoryError, match=sentence):
                vx.measures.energy_distance(back, history, kind="nodal")
        field = vx.measures.Field(back.mesh, 1.1 * back.displacement[-1], back.moduli, stabilisation=name)
        assert vx.measures.energy_distance(field, history, kind="nodal").absolute == pytest.approx(expected, rel=1e-12)


class Softer(vx.Elasticity):
    """A material whose stiffness does not use the field `stabilisation`."""

    def contribute(self, space):
        ours = super().contribute(space)
        unit = vx.Elasticity(self.young, self.poisson, stabilisation="unit").contribute(space).material
        return dataclasses.replace(ours, stiffness=unit.stiffness(space))


@pytest.mark.long
def test_budgets_for_a_stiffness_with_another_form_are_refused():
    scene = vx.Scene(Softer(YOUNG, POISSON), vx.Clamp(on="left"), vx.Traction((0.3, 0.1), on="right"))
    history = vx.simulate(scene, small("voronoi", 3), [0.0, 1.0], initial="settled")
    with pytest.raises(vx.SceneError, match=r"has the energy .*by the moduli .*must agree"):
        vx.error_budget(history)


def compute_squares(history):
    """Return squared parts of the budget, and the number of cells with the energies `along` < `stabilised`.

    "stabilisation" is the sum of the larger energies. "jumps" and "boundary" lack the factor `CONSTANT`^2.
    """
    mesh, u, posed = history.mesh, history.displacement[-1], pose_scene(history.scene, history.mesh)
    C, strain = np.diag([2 * MU, 2 * MU, MU]) + LAM * np.outer([1, 1, 0], [1, 1, 0]), strains(posed.space, u)
    xx, yy, xy = C @ strain.T
    stress = np.array([[xx, xy], [xy, yy]]).transpose(2, 0, 1)
    stabilised, along, sides = posed.material.stabilisation_energies(posed.space, u), np.zeros(mesh.n_cells), {}
    for k, cell in enumerate(mesh.cells):
        for i, j in zip(cell, np.roll(cell, -1), strict=True):
            edge = mesh.points[j] - mesh.points[i]
            length, t = np.linalg.norm(edge), edge / np.linalg.norm(edge)
            normal = np.array([t[1], -t[0]])
            width, dyad = np.ptp(mesh.points[cell] @ normal), np.array([t[0] ** 2, t[1] ** 2, t[0] * t[1]])
            young = 1.0 / (dyad @ np.linalg.inv(C) @ dyad)
            apart = (u[j] - u[i]) @ t / length - dyad @ strain[k]
            along[k] += width * young / 6.0 * apart**2 * length
            sides.setdefault(frozenset((i, j)), []).append((k, normal, length, width))
    jumps = boundary = 0.0
    for ends, both in sides.items():
        middle, (k, normal, length, d) = mesh.points[list(ends)].mean(axis=0), both[0]
        if len(both) == 2:
            (other, _, _, e) = both[1]
            jump = (stress[k] - stress[other]) @ normal
            jumps += 0.5 * (d + e) / (4 * MU) * jump @ jump * length
        elif middle[0] > 1e-9:  # the left side is clamped
            rest = (np.array([0.3, 0.1]) if middle[0] > 1 - 1e-9 else 0.0) - stress[k] @ normal
            boundary += d / (2 * MU) * rest @ rest * length
    squares = {"jumps": jumps, "boundary": boundary, "stabilisation": np.maximum(stabilised, along).sum()}
    return squares, (along < stabilised).sum()


def test_the_budget_is_the_sum_over_edges_of_its_formula():
    history = simulate_bar(own.Boundary(), small("voronoi", 4))
    budget, (expected, count) = vx.error_budget(history, -1), compute_squares(history)
    expected["jumps"], expected["boundary"] = (CONSTANT**2 * expected[name] for name in ("jumps", "boundary"))
    squares = {name: (part[0] * budget.scale) ** 2 for name, part in budget.parts.items()}
    assert squares.pop("data") < 1e-24 * sum(expected.values())  # rounding error of a constant traction
    assert squares == pytest.approx(expected | {"volume": 0.0}, rel=1e-10, abs=0.0)
    assert (budget.space[0] * budget.scale) ** 2 == pytest.approx(sum(expected.values()), rel=1e-10)
    assert count == 16


@pytest.mark.long
def test_bounds_hold_whatever_the_stabilisation():
    """Bounds enclose the exact energy and potential, so the intervals of two meshes overlap."""
    fine = vx.error_bound(simulate_bar("shear", vx.meshes.squares(16)), step=1)
    for stabilisation in ("unit", *OWN):
        bound = vx.error_bound(simulate_bar(stabilisation, small("voronoi", 4)), step=1)
        for (low, high), (least, most) in ((bound.energy, fine.energy), (bound.potential, fine.potential)):
            assert low < most
            assert least < high
        assert 0 < bound.lower < bound.upper


class Wrong(vx.Stabilisation):
    """A stabilisation with the form change(mu I)."""

    def __init__(self, change):
        self.change = change

    def form(self, cells, C):
        return self.change(np.tile(MU * np.eye(4), (len(cells.nodes), 1, 1)))


def test_wrong_forms_are_refused():
    for change, words in (
        (lambda S: S + np.eye(4, k=1), "found a form of a cell with 4 vertices that differs from its transpose by"),
        (lambda S: S * [-10, 1, 1, 1], "found a cell with 4 vertices where some v - Pi v has no positive energy"),
        (lambda S: 0 * S, "found a cell with 4 vertices where some v - Pi v has no positive energy"),
        (lambda S: np.nan * S, "form: found NaN or infinite values"),
        (lambda S: S[:, :2], r"found a form of shape \(4, 2, 4\) for 4 cells with 4 vertices"),
        (lambda S: "none", "form: found 'none'"),
        (lambda S: 1 / 0, "its form failed when called with cells of 4 vertices: ZeroDivisionError: division by zero"),
    ):
        scene = vx.Scene(vx.Elasticity(YOUNG, POISSON, stabilisation=Wrong(change)), vx.Clamp(on="left"))
        with pytest.raises(vx.SceneError, match=f"Wrong: {words}"):
            pose_scene(scene, vx.meshes.squares(2))


class Springs(vx.Stabilisation):
    """A stabilisation in space: mu h_K for every component at every vertex, half of the default."""

    def form(self, cells, C):
        weights = C[:, 3, 3] * cells.stabilised_size
        return weights[:, None, None] * np.eye(cells.nodes.shape[1])


@pytest.mark.long
@pytest.mark.parametrize("family", ["prisms", "cubes", "voronoi3"])
def test_stabilisations_in_space(family):
    """Stabilisation energies are half of the default energies, and are part of the nodal distance."""
    mesh, material = vx.meshes.SPACE_FAMILIES[family](2), vx.Elasticity(YOUNG, POISSON, stabilisation=Springs())
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
