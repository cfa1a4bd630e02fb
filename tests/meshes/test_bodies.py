"""Several bodies in one plane mesh: matched interfaces, names and data, cracks, and refusals."""

from __future__ import annotations

import itertools
import pickle
from dataclasses import replace

import meshio
import numpy as np
import pytest
from same_mesh import assert_matched, assert_same, measure_part
from scenes import mostly_long

import vemcvx as vx
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES, PolygonMesh, bodies, ring, squares

EPS = np.finfo(float).eps
NEXT_DOOR = ((1, 2), (0, 1))
EVERY = FAMILIES | SPACE_FAMILIES


@pytest.mark.parametrize(("below", "above"), [*itertools.pairwise([*FAMILIES, "squares"])])
def test_blocks_of_two_families_match(below, above):
    lower = FAMILIES[below]((7, 3), ((0, 1), (0, 0.5)), seed=1)
    upper = FAMILIES[above]((5, 2), ((0, 1), (0.5, 1.1)), seed=2)
    mesh = bodies({"lower": lower, "upper": upper})
    assert_matched(mesh)
    found = mesh.interfaces["lower|upper"]
    assert found.bodies == ("lower", "upper")
    sides = lower.points[lower.boundaries["top"], 0], upper.points[upper.boundaries["bottom"], 0]
    places = np.unique(np.concatenate([side.ravel() for side in sides]))
    np.testing.assert_array_equal(np.unique(mesh.points[found.edges, 0]), places)
    assert measure_part(mesh, "lower|upper") == pytest.approx(1.0, abs=len(places) * EPS)
    np.testing.assert_allclose(mesh.areas, np.concatenate([lower.areas, upper.areas]), rtol=1e-13)
    np.testing.assert_array_equal(mesh.cell_data["body"], np.repeat([0, 1], [lower.n_cells, upper.n_cells]))
    assert set(mesh.boundaries) == {
        *(f"lower.{name}" for name in ("left", "right", "bottom")),
        *(f"upper.{name}" for name in ("left", "right", "top")),
        *("lower|upper", "boundary"),
    }


def test_refinement_keeps_interfaces_matched():
    blocks = {
        "lower": FAMILIES["voronoi"]((4, 2), ((0, 1), (0, 0.5)), seed=1),
        "upper": squares((3, 3), ((0.25, 1.1), (0.5, 1.1))),
        "beside": squares((2, 3), ((1, 1.3), (0.1, 0.5))),
    }
    mesh, random = bodies(blocks), np.random.default_rng(3)
    edges_at_start = len(mesh.interfaces["lower|upper"].edges)
    for _ in range(3):
        before = mesh
        mesh = mesh.refine(random.random(mesh.n_cells) < 0.4)
        assert_matched(mesh)
        assert list(mesh.boundaries) == list(before.boundaries)
        for name in before.boundaries:
            assert measure_part(mesh, name) == pytest.approx(measure_part(before, name), abs=1e-12)
    assert len(mesh.interfaces["lower|upper"].edges) > edges_at_start


IN_PLANE = ("meshio", "voronoi", "hexagons", "triangles")
IN_SPACE = pytest.param("pyvista", "tetrahedra", "cubes", "voronoi3", marks=pytest.mark.long)


@pytest.mark.parametrize(("library", "first", "middle", "right"), [IN_PLANE, IN_SPACE])
def test_files_pickles_and_libraries_keep_interfaces(tmp_path, library, first, middle, right):
    """Join three bodies in a row. Some sides touch only partly, and two names are unusual."""
    pytest.importorskip(library)
    boxes = ((0, 1), (0, 1)), ((1, 2), (0.25, 1.5)), ((2, 3), (-1, 1))
    up = [(0, 1)] * (first in SPACE_FAMILIES)
    parts = [EVERY[name](3, (*box, *up), seed=1) for name, box in zip((first, middle, right), boxes, strict=True)]
    parts[0] = parts[0].with_cell_data("E", np.arange(float(parts[0].n_cells)))
    mesh = bodies(
        dict(zip(("größe <&:/>", "middle", "right"), parts, strict=True)), {"joint: a|b": ("right", "middle")}
    )
    assert {name: found.bodies for name, found in mesh.interfaces.items()} == {
        "größe <&:/>|middle": ("größe <&:/>", "middle"),
        "joint: a|b": ("right", "middle"),
    }
    mesh.write(tmp_path / "mesh.vtu")
    assert_same(mesh, vx.meshes.read(tmp_path / "mesh.vtu"))
    assert_same(mesh, pickle.loads(pickle.dumps(mesh)))
    assert_same(mesh, vx.meshes.convert(mesh.to(library)))


def test_histories_keep_interfaces_and_files_without_them_are_refused(tmp_path):
    mesh = bodies({"a": squares(1), "b": squares(1, NEXT_DOOR)})
    scene = vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp(["a.left", "b.right"]), vx.BodyForce(lambda x, t: x * t))
    vx.simulate(scene, mesh, [0.0, 1.0]).write(tmp_path)
    assert_same(mesh, vx.read_history(tmp_path).mesh)
    meshio.Mesh(mesh.points, [("quad", np.stack(mesh.cells))]).write(tmp_path / "mesh.vtu", file_format="vtu")
    with pytest.raises(vx.MeshError, match=r"mesh.vtu: nodes 1 and 4 are in the same place.*vx.meshes.bodies"):
        vx.meshes.read(tmp_path / "mesh.vtu")


def test_the_part_of_a_side_beside_the_interface_keeps_its_name():
    """Put a block on a wider block. Two corners of the upper block become hanging nodes."""
    mesh = bodies({"lower": squares((2, 1), ((0, 2), (0, 1))), "upper": squares((3, 1), ((0.3, 1.1), (1, 2)))})
    assert_matched(mesh)
    x = mesh.points[mesh.interfaces["lower|upper"].edges, 0]
    assert (x.min(), x.max()) == (0.3, 1.1)
    assert 1.0 in x
    left = mesh.points[mesh.boundaries["lower.top"]][..., 0]
    assert {tuple(ends) for ends in np.sort(left).tolist()} == {(0.0, 0.3), (1.1, 2.0)}
    assert "upper.bottom" not in mesh.boundaries
    # Nodes of a body keep the old order. Hanging nodes come last.
    np.testing.assert_array_equal(mesh.points[:6], squares((2, 1), ((0, 2), (0, 1))).points)


def test_interfaces_meet_in_crosspoints():
    mesh = bodies(
        {
            "left": FAMILIES["voronoi"](3, seed=1),
            "right": FAMILIES["distorted"](4, NEXT_DOOR, seed=2),
            "above": FAMILIES["hexagons"]((7, 3), ((0, 2), (1, 2))),
        }
    )
    assert_matched(mesh)
    found = {name: round(measure_part(mesh, name), 14) for name in mesh.interfaces}
    assert found == {"left|right": 1.0, "left|above": 1.0, "right|above": 1.0}
    cross = np.flatnonzero((mesh.points == [1.0, 1.0]).all(axis=1))
    pairs = np.sort(np.concatenate([found.pairs for found in mesh.interfaces.values()]))
    at_cross = sorted(map(tuple, pairs[np.isin(pairs, cross).any(axis=1)].tolist()))
    assert at_cross == list(itertools.combinations(cross.tolist(), 2))
    corners = {"a": (0, 0), "b": (1, 0), "c": (0, 1), "d": (1, 1)}
    mesh = bodies({name: squares(k + 2, ((x, x + 1), (y, y + 1))) for k, (name, (x, y)) in enumerate(corners.items())})
    assert_matched(mesh)
    assert set(mesh.interfaces) == {"a|b", "a|c", "b|d", "c|d"}
    assert repr(mesh).endswith("boundaries: a.left, a.bottom, b.right, b.bottom, 8 more, boundary)")


def test_two_polygons_of_one_circle_take_the_shape_of_the_first():
    """A hub of n = 12 sides and a tyre of 60 sides meet at the unit circle. The gap is at most 1 - cos(pi / n)."""
    sides, apart = 12, 1.0 - np.cos(np.pi / 12)
    hub, tyre = ring([0.3, 0.6, 1.0], sides), ring([1.0, 1.5, 2.0], 60, angles=(0.01, 0.01 + 2 * np.pi))
    mesh = bodies({"hub": hub, "tyre": tyre}, tolerance=1.01 * apart)
    assert_matched(mesh)
    perimeter = 2.0 * sides * np.sin(np.pi / sides)
    rounding = 4 * len(mesh.interfaces["hub|tyre"].edges) * EPS
    assert measure_part(mesh, "hub|tyre") == pytest.approx(perimeter, abs=rounding)
    original = np.concatenate([hub.points, tyre.points])
    shift = np.hypot(*(mesh.points[: len(original)] - original).T)
    assert not shift[: hub.n_nodes].any()
    assert 0.0 < shift.max() <= 1.01 * apart
    with pytest.raises(vx.MeshError, match="'hub' and 'tyre' overlap near .* give tolerance="):
        bodies({"hub": hub, "tyre": tyre})


def test_three_bodies_at_one_edge_overlap():
    """Put two equal discs into the hole of a plate."""
    plate = PolygonMesh(
        [(0, 0), (3, 0), (3, 3), (0, 3), (1, 1), (2, 1), (2, 2), (1, 2)],
        [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
    )
    disc = squares(2, ((1, 2), (1, 2)))
    assert len(bodies({"disc": disc, "plate": plate}).interfaces["disc|plate"].edges) == 8
    with pytest.raises(vx.MeshError, match="'one' and 'other' overlap near"):
        bodies({"one": disc, "plate": plate, "other": disc})


def test_cell_data_of_one_body_are_zero_on_the_others():
    """A body and a cell datum may have the same name, "soft", if the datum is 1 on this body."""
    soft = squares(1).with_cell_data("E", [2.5]).with_cell_data("soft", np.ones(1))
    hard = squares(1, NEXT_DOOR).with_cell_data("core", [True])
    mesh = bodies({"soft": soft, "hard": hard})
    np.testing.assert_array_equal(mesh.cell_data["E"], [2.5, 0.0])
    np.testing.assert_array_equal(mesh.cell_data["core"], [False, True])
    np.testing.assert_array_equal(mesh.cell_data["soft"], [1, 0])
    apart = bodies({"a": squares(2), "b": squares(3, ((1.5, 2), (0, 1)))})
    assert apart.interfaces == {}
    np.testing.assert_array_equal(apart.cell_data["b"], apart.centroids[:, 0] > 1.5)


def test_invalid_interfaces_are_refused():
    mesh = bodies({"a": squares(2), "b": squares(2, NEXT_DOOR)})
    found = mesh.interfaces["a|b"]
    for wrong, subject in (
        (replace(found, edges=found.edges[:, ::-1], partners=found.partners[:, ::-1]), "is not on the boundary"),
        (replace(found, partners=found.partners[:, ::-1]), "are partners at an interface, but lie at"),
        (replace(found, partners=found.partners[:1]), "edges and partners must be nodes 0 to"),
        (replace(found, bodies=("a",)), "with the names of two bodies"),
        (found.edges, "must be an Interface"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            PolygonMesh(mesh.points, mesh.cells, interfaces={"a|b": wrong})
    with pytest.raises(vx.MeshError, match="the interface of 'b' and 'a' has two names"):
        bodies({"a": squares(2), "b": squares(2, NEXT_DOOR)}, {"one": ("a", "b"), "two": ("b", "a")})


@mostly_long("family", EVERY, "voronoi", "triangles", "tetrahedra")
def test_a_crack_inside_a_body_has_two_lips_and_a_tip(family):
    """Cut from the left side to the middle. The node at the tip stays single, and points of both lips coincide."""
    whole = EVERY[family](3 if family == "kelvin" else 4, seed=1).with_boundary("half", lambda x: x[:, 0] < 0.5)
    near = whole.centroids[:, 0] < 0.5
    above = near & (whole.centroids[:, -1] > 0.5)
    mesh = whole.cut("crack", {"upper lip": above, "lower lip": np.flatnonzero(near & ~above)})
    found = mesh.interfaces["crack"]
    assert found.bodies == ("upper lip", "lower lip")
    np.testing.assert_array_equal(*mesh.points[found.pairs].swapaxes(0, 1))
    single = found.pairs[:, 0] == found.pairs[:, 1]
    assert 0 < single.sum() < len(single)
    assert single.sum() == 1 or family in SPACE_FAMILIES
    assert mesh.n_nodes == whole.n_nodes + (~single).sum()
    np.testing.assert_array_equal(mesh.points[: whole.n_nodes], whole.points)
    np.testing.assert_allclose(mesh.centroids, whole.centroids, atol=1e-14)
    for name in ("left", "half", "right", "top"):
        assert measure_part(mesh, name) == pytest.approx(measure_part(whole, name), rel=1e-14)
    assert len(mesh.boundaries["boundary"]) == len(whole.boundaries["boundary"]) + 2 * len(found.edges)
    assert_same(type(mesh)(mesh.points, mesh.cells, interfaces=mesh.interfaces), mesh, parts=())
    if family in FAMILIES or family == "tetrahedra":
        finer = mesh.refine(mesh.centroids[:, 0] < 0.7)
        type(finer)(finer.points, finer.cells, interfaces=finer.interfaces)
        assert measure_part(finer, "crack") == pytest.approx(measure_part(mesh, "crack"), rel=1e-12)


def test_a_cut_through_a_mesh_gives_the_mesh_of_two_bodies():
    mesh = squares(4)
    right = mesh.centroids[:, 0] > 0.5
    parted = mesh.cut("joint", {"left": ~right, "right": right})
    joined = bodies({"left": squares((2, 4), ((0, 0.5), (0, 1))), "right": squares((2, 4), ((0.5, 1), (0, 1)))})
    assert measure_part(parted, "joint") == measure_part(joined, "left|right") == 1.0
    assert parted.n_nodes == joined.n_nodes
    # Two more cuts end at the joint. Then the four quarters share no node.
    top = mesh.centroids[:, 1] > 0.5
    quarters = parted.cut("west", {"a": ~right & top, "b": ~right & ~top})
    quarters = quarters.cut("east", {"c": right & top, "d": right & ~top})
    assert quarters.n_nodes == 4 * 9
    PolygonMesh(quarters.points, quarters.cells, interfaces=quarters.interfaces)


def test_new_parts_of_the_boundary_exclude_interfaces():
    mesh = bodies({"a": squares(2), "b": squares(2, NEXT_DOOR)})
    seen = []
    named = mesh.with_boundary("all", lambda x: seen.append(x) or x[:, 0] < 9.0)
    assert not (seen[0][:, 0] == 1.0).any()
    assert len(named.boundaries["all"]) == len(mesh.boundaries["boundary"]) - 2 * len(mesh.interfaces["a|b"].edges)


def test_parts_of_a_mesh_fit_together_again():
    """Refine the parts of a mesh, and shift the parts by less than the tolerance."""
    random, whole = np.random.default_rng(3), FAMILIES["nonconvex"](6, seed=3)
    part = np.argmin(np.linalg.norm(whole.centroids[:, None] - random.random((4, 2)), axis=2), axis=1)
    parts = {}
    for number in range(4):
        cells = [whole.cells[cell] for cell in np.flatnonzero(part == number)]
        nodes = np.unique(np.concatenate(cells))
        points = whole.points[nodes] + 1e-11 * random.normal(size=2)
        mesh = PolygonMesh(points, [np.searchsorted(nodes, cell) for cell in cells])
        parts[f"part {number}"] = mesh.refine(random.random(mesh.n_cells) < 0.4)
    mesh = bodies(parts)
    assert_matched(mesh)
    inner = sum(measure_part(mesh, name) for name in mesh.interfaces)
    around = sum(measure_part(part, "boundary") for part in parts.values())
    assert inner == pytest.approx((around - 4.0) / 2.0, abs=1e-9)
