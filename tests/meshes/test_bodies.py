"""Several bodies in one mesh: interfaces, what becomes of names and data, and what is refused."""

from __future__ import annotations

import itertools
import pickle
import re
from dataclasses import replace

import meshio
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from same_mesh import assert_same
from scenes import mostly_long

import vemcvx as vx
from vemcvx.meshes import FAMILIES, PolygonMesh, bodies, squares

EPS = np.finfo(float).eps
NEXT = dict(itertools.pairwise([*FAMILIES, "squares"]))
PAIRS = [
    (a, b) if NEXT[a] == b else pytest.param(a, b, marks=pytest.mark.slow)
    for a, b in itertools.product(FAMILIES, FAMILIES)
]


def lengths(mesh, edges):
    return np.hypot(*(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]]).T)


def assert_matched(mesh):
    """Both sides of each interface are edges of the boundary in the same places, to the bit; the whole is a mesh."""
    all_edges = set(map(tuple, mesh.boundaries["boundary"].tolist()))
    for name, found in mesh.interfaces.items():
        np.testing.assert_array_equal(mesh.points[found.edges], mesh.points[found.partners])
        assert set(map(tuple, found.edges.tolist())) <= all_edges
        assert set(map(tuple, found.partners[:, ::-1].tolist())) <= all_edges
        np.testing.assert_array_equal(mesh.boundaries[name], found.edges)
        for side, body in zip((found.edges, found.partners), found.bodies, strict=True):
            inside = np.isin(
                np.arange(mesh.n_nodes), mesh.vertices[np.repeat(mesh.cell_data[body] == 1, np.diff(mesh.offsets))]
            )
            assert inside[side].all()
    again = PolygonMesh(mesh.points, mesh.cells, interfaces=mesh.interfaces)
    assert len(again.boundaries["boundary"]) == len(mesh.boundaries["boundary"])


@pytest.mark.parametrize(("below", "above"), PAIRS)
@mostly_long("counts", [(7, 5), (1, 13)])
def test_blocks_of_every_family_match(below, above, counts):
    n, m = counts
    lower = FAMILIES[below]((n, max(1, n // 2)), ((0, 1), (0, 0.5)), seed=1)
    upper = FAMILIES[above]((m, max(1, m // 2)), ((0, 1), (0.5, 1.1)), seed=2)
    mesh = bodies({"lower": lower, "upper": upper})
    assert_matched(mesh)
    found = mesh.interfaces["lower|upper"]
    assert found.bodies == ("lower", "upper")
    along = {
        x for body, name in ((lower, "top"), (upper, "bottom")) for x in body.points[body.boundaries[name], 0].ravel()
    }
    assert set(mesh.points[found.edges, 0].ravel()) == along
    assert lengths(mesh, found.edges).sum() == pytest.approx(1.0, abs=len(along) * EPS)
    # Hanging vertices on straight sides move nothing, and areas are sums over as many vertices.
    np.testing.assert_allclose(mesh.areas, np.concatenate([lower.areas, upper.areas]), rtol=1e-13)
    assert set(mesh.boundaries) == {
        *(f"lower.{name}" for name in ("left", "right", "bottom")),
        *(f"upper.{name}" for name in ("left", "right", "top")),
        *("lower|upper", "boundary"),
    }


def test_materials_of_bodies_are_named_by_the_bodies():
    mesh = bodies({"lower": squares(2), "upper": squares(3, ((0, 1), (1, 2)))})
    np.testing.assert_array_equal(mesh.cell_data["body"], [0] * 4 + [1] * 9)
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3, on="lower"),
        vx.Elasticity(1.0, 0.3, on="upper"),
        vx.Clamp(on=["lower.bottom", "upper.top"]),
        vx.Traction(lambda x, t: np.full((len(x), 2), t), on="upper.right"),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    np.testing.assert_array_equal(history.displacement[-1][mesh.points[:, 1] < 1.0], 0.0)


@pytest.mark.parametrize("balance", [True, pytest.param(False, marks=pytest.mark.long)])
@mostly_long("below, above", [("voronoi", "squares"), ("nonconvex", "triangles"), ("hanging", "hexagons")])
def test_refinement_keeps_interfaces_matched(below, above, balance):
    blocks = {
        "lower": FAMILIES[below]((4, 2), ((0, 1), (0, 0.5)), seed=1),
        "upper": FAMILIES[above]((3, 3), ((0.25, 1.1), (0.5, 1.1)), seed=2),
        "beside": FAMILIES[above]((2, 3), ((1, 1.3), (0.1, 0.5)), seed=2),
    }
    mesh, random = bodies(blocks), np.random.default_rng(3)
    for _ in range(4):
        before = mesh
        mesh = mesh.refine(random.random(mesh.n_cells) < 0.4, balance=balance)
        assert_matched(mesh)
        assert list(mesh.boundaries) == list(before.boundaries)
        for name, edges in before.boundaries.items():
            new = mesh.boundaries[name]
            assert lengths(mesh, new).sum() == pytest.approx(lengths(before, edges).sum(), abs=len(new) * EPS)
    assert len(mesh.interfaces["lower|upper"].edges) > len(bodies(blocks).interfaces["lower|upper"].edges)


def three_blocks():
    """A row of three whose faces overlap in part, with names that are hard to spell."""
    return bodies(
        {
            "größe <&:/>": FAMILIES["voronoi"](3, ((0, 1), (0, 1)), seed=1).with_cell_data("E", np.arange(9.0)),
            "middle": FAMILIES["hexagons"](4, ((1, 2), (0.25, 1.5))),
            "right": FAMILIES["triangles"](3, ((2, 3), (-1, 1))),
        },
        interfaces={"joint: a|b": ("right", "middle")},
    )


def test_files_pickles_histories_and_other_libraries_keep_interfaces(tmp_path):
    mesh = three_blocks()
    assert {name: found.bodies for name, found in mesh.interfaces.items()} == {
        "größe <&:/>|middle": ("größe <&:/>", "middle"),
        "joint: a|b": ("right", "middle"),
    }
    mesh.write(tmp_path / "mesh.vtu")
    assert_same(mesh, vx.meshes.read(tmp_path / "mesh.vtu"))
    assert_same(mesh, pickle.loads(pickle.dumps(mesh)))
    assert_same(mesh, vx.meshes.convert(mesh.to("meshio")))
    mesh = bodies({"a": squares(1), "b": squares(1, ((1, 2), (0, 1)))})
    scene = vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp(["a.left", "b.right"]), vx.BodyForce(lambda x, t: x * t))
    vx.simulate(scene, mesh, [0.0, 1.0]).write(tmp_path)
    assert_same(mesh, vx.read_history(tmp_path).mesh)
    meshio.Mesh(mesh.points, [("quad", np.stack(mesh.cells))]).write(tmp_path / "mesh.vtu", file_format="vtu")
    with pytest.raises(vx.MeshError, match=r"mesh.vtu: nodes 1 and 4 are in the same place.*vx.meshes.bodies"):
        vx.meshes.read(tmp_path / "mesh.vtu")


def total(mesh, name):
    return lengths(mesh, mesh.interfaces[name].edges).sum()


def test_part_of_a_side_stays_boundary():
    """[0.3, 1.1] of the top of the lower block [0, 2] is covered: both ends hang on it, the rest keeps its name."""
    mesh = bodies({"lower": squares((2, 1), ((0, 2), (0, 1))), "upper": squares((3, 1), ((0.3, 1.1), (1, 2)))})
    assert_matched(mesh)
    found = mesh.interfaces["lower|upper"]
    x = mesh.points[found.edges, 0]
    assert x.min() == 0.3
    assert x.max() == 1.1
    assert 1.0 in x
    left = mesh.points[mesh.boundaries["lower.top"]][..., 0]
    assert {tuple(ends) for ends in np.sort(left).tolist()} == {(0.0, 0.3), (1.1, 2.0)}
    assert "upper.bottom" not in mesh.boundaries
    # Each run of nodes of a body stands in its order, and then come the hanging ones.
    np.testing.assert_array_equal(mesh.points[:6], squares((2, 1), ((0, 2), (0, 1))).points)


def test_interfaces_meet_in_crosspoints():
    """Two blocks side by side under a third: three nodes where all meet, each with its partners."""
    mesh = bodies(
        {
            "left": FAMILIES["voronoi"](3, seed=1),
            "right": FAMILIES["distorted"](4, ((1, 2), (0, 1)), seed=2),
            "above": FAMILIES["hexagons"]((7, 3), ((0, 2), (1, 2))),
        }
    )
    assert_matched(mesh)
    assert {name: round(total(mesh, name), 14) for name in mesh.interfaces} == {
        "left|right": 1.0,
        "left|above": 1.0,
        "right|above": 1.0,
    }
    cross = np.flatnonzero((mesh.points == [1.0, 1.0]).all(axis=1))
    pairs = np.sort(np.concatenate([found.pairs for found in mesh.interfaces.values()]))
    assert sorted(map(tuple, pairs[np.isin(pairs, cross).any(axis=1)].tolist())) == list(
        itertools.combinations(cross.tolist(), 2)
    )


def test_four_blocks_may_meet_in_a_point():
    corners = {"a": (0, 0), "b": (1, 0), "c": (0, 1), "d": (1, 1)}
    mesh = bodies({name: squares(k + 2, ((x, x + 1), (y, y + 1))) for k, (name, (x, y)) in enumerate(corners.items())})
    assert_matched(mesh)
    assert set(mesh.interfaces) == {"a|b", "a|c", "b|d", "c|d"}
    assert repr(mesh).endswith("boundaries: a.left, a.bottom, b.right, b.bottom, 8 more, boundary)")


@mostly_long("order", [1, -1])
def test_an_interface_goes_round_a_corner(order):
    """The re-entrant corner of an L, filled by a block: one interface of two sides."""
    parts = {"corner": vx.meshes.l_shape(6), "block": FAMILIES["voronoi"](5, ((0.5, 1), (0.5, 1)), seed=3)}
    mesh = bodies(dict(list(parts.items())[::order]), interfaces={"L": ("corner", "block")})
    assert_matched(mesh)
    assert mesh.interfaces["L"].bodies == ("corner", "block")
    assert total(mesh, "L") == pytest.approx(1.0, abs=50 * EPS)
    assert {"corner.inner_right", "corner.inner_top", "block.left", "block.bottom"}.isdisjoint(mesh.boundaries)
    part = vx.vem.Space(mesh).part("L", "test", contact=True)
    beyond = vx.vem.edge_part(mesh.interfaces["L"].partners[:, ::-1], mesh.points)
    np.testing.assert_array_equal(part.node_lengths.sum(), beyond.node_lengths.sum())
    facing = {tuple(normal) for normal in part.normals.tolist()}
    assert facing == {(1.0, 0.0), (0.0, 1.0)} == {(abs(x), abs(y)) for x, y in beyond.normals.tolist()}
    assert (beyond.normals <= 0.0).all()


def ring(inner, outer, around, turned=0.0):
    angle = 2.0 * np.pi * np.arange(around) / around + turned
    points = [(r * np.cos(a), r * np.sin(a)) for r in np.linspace(inner, outer, 4) for a in angle]
    first = np.add.outer(around * np.arange(3), np.arange(around)).ravel()
    after = first - first % around + (first + 1) % around
    return PolygonMesh(points, np.column_stack([first, first + around, after + around, after]))


@mostly_long("hub, tyre, turned", [(24, 31, 0.0), (12, 60, 0.01), (32, 32, 0.05)], 1)
def test_polygons_of_one_circle_take_the_shape_of_the_first(hub, tyre, turned):
    """Press fit: the polygons of the common circle are up to 1 - cos(pi / n) apart."""
    parts = {"hub": ring(0.3, 1.0, hub), "tyre": ring(1.0, 2.0, tyre, turned)}
    apart = 1.0 - np.cos(np.pi / min(hub, tyre))
    mesh = bodies(parts, tolerance=1.01 * apart)
    assert_matched(mesh)
    # The perimeter of the hub's polygon, summed over edges; the hub is as it was, and nodes of the tyre moved little.
    edges = mesh.interfaces["hub|tyre"].edges
    assert total(mesh, "hub|tyre") == pytest.approx(2.0 * hub * np.sin(np.pi / hub), abs=4 * len(edges) * EPS)
    given = np.concatenate([part.points for part in parts.values()])
    moved = np.hypot(*(mesh.points[: len(given)] - given).T)
    assert not moved[: parts["hub"].n_nodes].any()
    assert 0.0 < moved.max() <= 1.01 * apart
    with pytest.raises(vx.MeshError, match="'hub' and 'tyre' overlap near .* give tolerance="):
        bodies(parts)


@pytest.mark.long
@given(
    shift=st.floats(-0.9, 0.9),
    turn=st.floats(0.0, 6.3),
    scale=st.sampled_from([1e-6, 1.0, 1e6]),
    families=st.tuples(st.sampled_from(sorted(FAMILIES)), st.sampled_from(sorted(FAMILIES))),
)
@settings(max_examples=10, deadline=None)
def test_blocks_match_wherever_they_lie(shift, turn, scale, families):
    """Shifted along each other and turned together: the common part is 1 - |shift| long, to rounding."""
    Q = scale * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    boxes = ((0, 1), (0, 1)), ((shift, shift + 1), (1, 1.5))
    flat = [FAMILIES[family](n, box, seed=1) for family, n, box in zip(families, (4, 3), boxes, strict=True)]
    lower, upper = (PolygonMesh(part.points @ Q.T, part.cells) for part in flat)
    top, bottom = flat[0].points[flat[0].boundaries["top"], 0], flat[1].points[flat[1].boundaries["bottom"], 0]
    all_x = np.unique(np.concatenate([top.ravel(), bottom.ravel()]))
    assume(np.diff(all_x)[np.diff(all_x) > 1e-15].min() > 1e-8)  # closer ones are one node
    mesh = bodies({"lower": lower, "upper": upper})
    assert_matched(mesh)
    edges = mesh.interfaces["lower|upper"].edges
    assert total(mesh, "lower|upper") == pytest.approx(scale * (1.0 - abs(shift)), abs=scale * len(edges) * 8 * EPS)


NEXT_DOOR = ((1, 2), (0, 1))
OVERLAPPING = [((0.3, 0.6), (0.3, 0.6)), ((0, 1), (0, 1)), ((0.9, 2), (0.8, 2)), ((1 - 1e-5, 2), (0.2, 0.8))]
REFUSED = [
    (((1, 2), (1, 2)), {}, r"'a' and 'b' touch only in the point \(1, 1\)"),
    (((1 + 1e-4, 2), (0, 1)), {}, r"'a' and 'b' are 0.0001 apart near \(1"),
    (((1.5, 2), (0, 1)), {"interfaces": {"joint": ("a", "b")}}, "interface 'joint' .* do not coincide"),
    (NEXT_DOOR, {"interfaces": {"joint": ("a", "c")}}, "interface 'joint' .*two of the bodies"),
    (NEXT_DOOR, {"interfaces": {"k": ("a", "b"), "l": ("b", "a")}}, "the interface of 'b' and 'a' is named twice"),
    (NEXT_DOOR, {"interfaces": {"boundary": ("a", "b")}}, "the name 'boundary' is taken"),
    (NEXT_DOOR, {"tolerance": 0.6}, "two nodes of 'a' near"),
    (NEXT_DOOR, {"tolerance": -1.0}, "tolerance must be a length below the extent 2"),
]


def test_overlap_errors_name_a_point_of_the_overlap():
    for box in (*OVERLAPPING, ((0.2, 0.8), (-1, 2))):
        with pytest.raises(vx.MeshError, match="'a' and 'b' overlap near") as caught:
            bodies({"a": squares(2), "b": squares(3, box)})
        at = map(float, re.search(r"\((\S+), (\S+)\)", str(caught.value)).groups())
        for x, side, other in zip(at, box, ((0, 1), (0, 1)), strict=True):
            assert max(side[0], other[0]) <= x <= min(side[1], other[1])
    for box, options, subject in REFUSED:
        with pytest.raises(vx.MeshError, match=subject):
            bodies({"a": squares(2), "b": squares(3, box)}, **options)


def test_three_in_one_place_overlap():
    """Each of the two discs fills the hole, so their edges are all in one place with those of the plate."""
    plate = PolygonMesh(
        [(0, 0), (3, 0), (3, 3), (0, 3), (1, 1), (2, 1), (2, 2), (1, 2)],
        [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
    )
    disc = squares(2, ((1, 2), (1, 2)))
    assert len(bodies({"disc": disc, "plate": plate}).interfaces["disc|plate"].edges) == 8
    with pytest.raises(vx.MeshError, match="'one' and 'other' overlap near"):
        bodies({"one": disc, "plate": plate, "other": disc})


def test_invalid_bodies_are_refused_and_data_may_exist_on_some_bodies():
    one, two = squares(1), squares(1, NEXT_DOOR)
    for meshes, subject in (
        ({"a": one}, "at least two bodies"),
        ({"a|b": one, "c": one}, "the name of a body must be a string without"),
        ({"body": one, "c": one}, "other than 'body'; got 'body'"),
        ({"a": one, "b": "squares"}, "the mesh of 'b' must be .* got 'squares'"),
        ({"a": one.with_cell_data("b", [1]), "b": two}, "cell datum 'b', a name that marks"),
        ({"a": bodies({"a": one, "b": two}), "c": one}, "'a' already has interfaces"),
        ({"a": one.with_cell_data("v", [[1, 2]]), "b": two.with_cell_data("v", [1])}, "'v' has rows of different"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            bodies(meshes)
    mesh = bodies({"soft": one.with_cell_data("E", [2.5]), "hard": two.with_cell_data("core", [True])})
    np.testing.assert_array_equal(mesh.cell_data["E"], [2.5, 0.0])
    np.testing.assert_array_equal(mesh.cell_data["core"], [False, True])
    apart = bodies({"a": squares(2), "b": squares(3, ((1.5, 2), (0, 1)))})
    assert apart.interfaces == {}
    np.testing.assert_array_equal(apart.cell_data["b"], apart.centroids[:, 0] > 1.5)


def test_invalid_interfaces_are_refused():
    mesh = bodies({"a": squares(2), "b": squares(2, NEXT_DOOR)})
    found = mesh.interfaces["a|b"]
    for wrong, subject in (
        (replace(found, edges=found.edges[:, ::-1], partners=found.partners[:, ::-1]), "is not an edge of the boundar"),
        (replace(found, partners=found.partners[:, ::-1]), "are partners at an interface, but lie at"),
        (replace(found, partners=found.partners[:1]), "rows of the same lengths; got 2 and 1 rows"),
        (replace(found, bodies=("a",)), "bodies must be two names"),
        (found.edges, "must be an Interface"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            PolygonMesh(mesh.points, mesh.cells, interfaces={"a|b": wrong})
    with pytest.raises(vx.MeshError, match="in the same place"):
        PolygonMesh(mesh.points, mesh.cells)


@mostly_long("family", ["squares", "voronoi", "triangles", "nonconvex"], 1, 2)
def test_a_crack_inside_a_body(family):
    """From the left side to the middle: one tip, where the node stays single; both lips have the same places."""
    whole = FAMILIES[family](6, seed=1).with_boundary("half", lambda x: x[:, 0] < 0.5)
    near = whole.centroids[:, 0] < 0.5
    above = near & (whole.centroids[:, 1] > 0.5)
    mesh = whole.cut("crack", {"upper lip": above, "lower lip": np.flatnonzero(near & ~above)})
    found = mesh.interfaces["crack"]
    assert found.bodies == ("upper lip", "lower lip")
    np.testing.assert_array_equal(mesh.points[found.edges], mesh.points[found.partners])
    same = np.unique(found.edges[found.edges == found.partners])
    assert len(same) == 1
    assert mesh.n_nodes == whole.n_nodes + len(np.unique(found.edges)) - 1
    np.testing.assert_array_equal(mesh.points[: whole.n_nodes], whole.points)
    np.testing.assert_array_equal(mesh.points[mesh.vertices], whole.points[whole.vertices])
    for name in ("left", "half", "right"):
        np.testing.assert_array_equal(mesh.points[mesh.boundaries[name]], whole.points[whole.boundaries[name]])
    assert len(mesh.boundaries["boundary"]) == len(whole.boundaries["boundary"]) + 2 * len(found.edges)
    PolygonMesh(mesh.points, mesh.cells, interfaces=mesh.interfaces)
    finer = mesh.refine(mesh.centroids[:, 0] < 0.7)
    PolygonMesh(finer.points, finer.cells, interfaces=finer.interfaces)
    assert total(finer, "crack") == pytest.approx(total(mesh, "crack"), abs=1e-13)


def test_a_cut_right_through_is_the_mesh_of_two_bodies():
    mesh = squares(4)
    right = mesh.centroids[:, 0] > 0.5
    parted = mesh.cut("joint", {"left": ~right, "right": right})
    joined = bodies({"left": squares((2, 4), ((0, 0.5), (0, 1))), "right": squares((2, 4), ((0.5, 1), (0, 1)))})
    assert total(parted, "joint") == total(joined, "left|right") == 1.0
    assert parted.n_nodes == joined.n_nodes
    # Across the joint, where the nodes stay double, a second cut meets it: the four quarters share no node.
    top = mesh.centroids[:, 1] > 0.5
    quarters = parted.cut("west", {"a": ~right & top, "b": ~right & ~top}).cut(
        "east", {"c": right & top, "d": right & ~top}
    )
    assert quarters.n_nodes == 4 * 9
    PolygonMesh(quarters.points, quarters.cells, interfaces=quarters.interfaces)


def test_invalid_cracks_are_refused():
    for name, sides, subject in (
        ("left", {"a": [5], "b": [6]}, "there already is a boundary 'left'"),
        ("crack", {"a": [5]}, "sides must map the names of two sides of the crack"),
        ("crack", {"a": [5], "b": [5, 6]}, "cell 5 is on both sides"),
        ("crack", {"a": [0], "b": [15]}, "the cells of 'a' and 'b' have no edge in common"),
        ("crack", {"a": [5], "b": [6]}, r"the edge at \(0.5, 0.375\) has a tip at both ends"),
        ("crack", {"a": [5], "b": [99]}, "cells of 'b' must be numbers of cells"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            squares(4).cut(name, sides)


def test_parts_of_the_boundary_are_chosen_beside_interfaces():
    mesh = bodies({"a": squares(2), "b": squares(2, NEXT_DOOR)})
    seen = []
    named = mesh.with_boundary("all", lambda x: seen.append(x) or x[:, 0] < 9.0)
    assert not (seen[0][:, 0] == 1.0).any()
    assert len(named.boundaries["all"]) == len(mesh.boundaries["boundary"]) - 2 * len(mesh.interfaces["a|b"].edges)
    for rename in (mesh.with_boundary, lambda name, _: mesh.with_boundaries({name: mesh.boundaries["a.left"]})):
        with pytest.raises(vx.MeshError, match=r"'a\|b' is an interface of this mesh; choose another name"):
            rename("a|b", lambda x: x[:, 0] < 9.0)


@mostly_long("family, seed", [("voronoi", 1), ("hexagons", 2), ("nonconvex", 3), ("triangles", 6)], 2)
def test_parts_of_one_mesh_fit_together_again(family, seed):
    """Polygonal interfaces: parts nearest to random points, each refined by itself, shifted less than the tolerance."""
    random = np.random.default_rng(seed)
    whole = FAMILIES[family](6, seed=seed)
    part = np.argmin(np.linalg.norm(whole.centroids[:, None] - random.random((4, 2)), axis=2), axis=1)
    parts = {}
    for number in np.unique(part):
        nodes, vertices = np.unique(
            np.concatenate([whole.cells[c] for c in np.flatnonzero(part == number)]), return_inverse=True
        )
        counts = np.diff(whole.offsets)[part == number]
        points = whole.points[nodes] + 1e-11 * random.normal(size=2)
        mesh = PolygonMesh(points, np.split(vertices, np.cumsum(counts)[:-1]))
        parts[f"part {number}"] = mesh.refine(random.random(mesh.n_cells) < 0.4)
    mesh = bodies(parts)
    assert_matched(mesh)
    inner = sum(total(mesh, name) for name in mesh.interfaces)
    around = sum(lengths(part, part.boundaries["boundary"]).sum() for part in parts.values())
    assert len(parts) == 4
    assert inner == pytest.approx((around - 4.0) / 2.0, abs=1e-9)
