"""Several bodies in space: tilings intersected, what becomes of names and data, and what is refused."""

from __future__ import annotations

import itertools
import pickle
from dataclasses import replace

import numpy as np
import pytest
from same_mesh import assert_same
from scenes import mostly_long, mostly_slow, small
from tubes import ring

import vemcvx as vx
from vemcvx.meshes import SPACE_FAMILIES, bodies, cubes
from vemcvx.meshes.interfaces import faces_of

FAMILIES = list(SPACE_FAMILIES)
EPS = np.finfo(float).eps


def turned(mesh, angle, about=(0.5, 0.5)):
    """The mesh turned about an upright axis."""
    c, s, axis = np.cos(angle), np.sin(angle), np.array([*about, 0.0])
    points = (mesh.points - axis) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + axis
    named = {name: faces for name, faces in mesh.boundaries.items() if name != "boundary"}
    return vx.PolyhedralMesh(points, mesh.cells, boundaries=named)


def assert_matched(mesh, area=None):
    """Both sides of interfaces are the same polygons, to the bit, seen from both sides; and the whole is a mesh."""
    total = 0.0
    for name, found in mesh.interfaces.items():
        there = found.edges >= 0
        np.testing.assert_array_equal(mesh.points[found.edges[there]], mesh.points[found.partners[there]])
        assert not np.isin(found.edges[there], found.partners[there]).any()
        first = mesh.boundaries[name]
        second = mesh.boundaries["boundary"][faces_of(found.partners, mesh._outlines)]
        np.testing.assert_allclose(mesh.face_normals[first], -mesh.face_normals[second], atol=1e-6)
        np.testing.assert_allclose(mesh.face_areas[first], mesh.face_areas[second], rtol=1e-6)
        for faces, body in zip((first, second), found.bodies, strict=True):
            assert (mesh.cell_data[body][mesh.face_cells[faces, 0]] == 1).all()
        total += mesh.face_areas[first].sum()
    again = vx.PolyhedralMesh(mesh.points, mesh.cells, interfaces=mesh.interfaces)
    assert_same(again, mesh, arrays=("points", "face_offsets", "face_vertices", "cell_faces"), parts=())
    if area is not None:
        assert total == pytest.approx(area, abs=1e-9)


def assert_blocks_match(below, above, angle):
    lower = SPACE_FAMILIES[below]((7, 7, 2), ((-1, 2), (-1, 2), (0, 1)), seed=1)
    upper = turned(SPACE_FAMILIES[above]((5, 5, 2), ((0, 1), (0, 1), (1, 2)), seed=2), angle)
    for meshes in ({"lower": lower, "upper": upper}, {"upper": upper, "lower": lower}):
        mesh = bodies(meshes)
        assert_matched(mesh, 1.0)
        np.testing.assert_allclose(mesh.volumes, np.concatenate([of.volumes for of in meshes.values()]), rtol=1e-12)
    return mesh


@pytest.mark.long
@pytest.mark.parametrize(("below", "above"), [*zip(FAMILIES, FAMILIES[1:] + FAMILIES[:1], strict=True)])
def test_turned_blocks_match(below, above):
    mesh = assert_blocks_match(below, above, 0.4)
    assert set(mesh.boundaries) == {
        *(f"lower.{name}" for name in ("left", "right", "front", "back", "bottom", "top")),
        *(f"upper.{name}" for name in ("left", "right", "front", "back", "top")),
        *("upper|lower", "boundary"),
    }


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 0.1, np.pi / 4, 1.0])
@pytest.mark.parametrize(("below", "above"), list(itertools.product(FAMILIES, FAMILIES)))
def test_blocks_of_every_family_match(below, above, angle):
    assert_blocks_match(below, above, angle)


def test_cubes_over_cubes_have_all_pieces():
    mesh = bodies({"lower": cubes(7), "upper": cubes(5, ((0, 1), (0, 1), (1, 2)))})
    assert_matched(mesh, 1.0)
    # Lines at sevenths and at fifths: twelve places along each axis, eleven strips.
    assert len(mesh.boundaries["lower|upper"]) == 11**2
    assert len(mesh.interfaces["lower|upper"].pairs) == 12**2
    assert mesh.n_cells == 7**3 + 5**3


def test_a_block_may_lie_on_one_face():
    """Around it the face has a hole, which polyhedra cannot have: the rest is cut in triangles."""
    mesh = bodies({"table": cubes(1), "box": cubes(2, ((0.3, 0.6), (0.3, 0.6), (1, 1.5)))})
    assert_matched(mesh, 0.09)
    top = mesh.boundaries["table.top"]
    assert mesh.face_areas[top].sum() == pytest.approx(1 - 0.09, abs=1e-12)
    assert (np.diff(mesh.face_offsets)[top] == 3).all()


@pytest.mark.long
def test_four_blocks_meet_at_an_edge_and_eight_at_a_point():
    four = {
        f"q{i}{j}": SPACE_FAMILIES[name]((2 + i + j, 2, 2), ((i, i + 1), (j, j + 1), (0, 1)))
        for (i, j), name in zip(itertools.product((0, 1), (0, 1)), FAMILIES, strict=False)
    }
    mesh = bodies(four)
    assert_matched(mesh, 4.0)
    assert set(mesh.interfaces) == {"q00|q01", "q00|q10", "q01|q11", "q10|q11"}
    middle = np.flatnonzero(np.isclose(mesh.points[:, :2], 1.0).all(axis=1))
    heights = np.unique(mesh.points[middle, 2])
    assert len(middle) == 4 * len(heights)
    eight = {
        f"q{i}{j}{k}": SPACE_FAMILIES[name](2 + (i + j + k) % 3, ((i, i + 1), (j, j + 1), (k, k + 1)), seed=i + j)
        for (i, j, k), name in zip(itertools.product((0, 1), (0, 1), (0, 1)), FAMILIES * 2, strict=False)
    }
    mesh = bodies(eight)
    assert_matched(mesh, 12.0)
    assert len(mesh.interfaces) == 12
    assert np.isclose(mesh.points, 1.0).all(axis=1).sum() == 8


@pytest.mark.long
def test_a_joint_may_end_on_a_third_body():
    mesh = bodies(
        {
            "left": SPACE_FAMILIES["tetrahedra"](2),
            "right": cubes(3, ((1, 2), (0, 1), (0, 1))),
            "lid": SPACE_FAMILIES["voronoi3"](3, ((0.3, 1.4), (0.2, 0.8), (1, 2))),
        },
        interfaces={"joint": ("right", "left")},
    )
    assert_matched(mesh, 1.0 + 1.1 * 0.6)
    assert {name: found.bodies for name, found in mesh.interfaces.items()} == {
        "joint": ("right", "left"),
        "left|lid": ("left", "lid"),
        "right|lid": ("right", "lid"),
    }


@pytest.mark.long
@mostly_slow("size", range(2, 14), 2, 6, 7)
def test_no_offset_is_too_small(size):
    """Tilings that are hardly apart: pieces as narrow as the tolerance, 2e-9 here, or nodes that are one."""
    for k, (name, exponent) in enumerate(itertools.product(("cubes", "tetrahedra", "kelvin"), (0.0, 0.5))):
        x, y = 10.0 ** -(size + exponent) * np.random.default_rng([size, k]).normal(size=2)
        make = SPACE_FAMILIES[name]
        assert_matched(bodies({"a": make(2), "b": make(2, ((x, 1 + x), (y, 1 + y), (1, 2)))}))


def written(mesh):
    """The mesh as a file with seven digits has it."""
    return vx.PolyhedralMesh(np.round(mesh.points, 7), mesh.cells)


@pytest.mark.long
@pytest.mark.parametrize(("below", "above"), [("cubes", "tetrahedra"), ("tetrahedra", "cubes"), ("cubes", "cubes")])
def test_a_tolerance_matches_what_was_written_with_seven_digits(below, above):
    """Nodes are hardly off edges in a plane; and on a curved surface hardly off the same places."""
    lower = written(SPACE_FAMILIES[below](3, ((-1, 2), (-1, 2), (0, 1))))
    upper = written(turned(SPACE_FAMILIES[above](3, ((0, 1), (0, 1), (1, 2))), 0.4))
    mesh = bodies({"lower": lower, "upper": upper}, tolerance=3e-7)
    assert mesh.face_areas[mesh.boundaries["lower|upper"]].sum() == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(mesh.volumes, np.concatenate([lower.volumes, upper.volumes]), rtol=1e-5)
    pin, lug = written(ring([0.4, 1.0], 16, 2)), ring([1.0, 2.0], 16, 2)
    mesh = bodies({"pin": pin, "lug": lug}, tolerance=3e-7)
    assert mesh.face_areas[mesh.boundaries["pin|lug"]].sum() == pytest.approx(32 * np.sin(np.pi / 16), rel=1e-7)


def rounded(n, size, hollow=False):
    """Tetrahedra of a cube of half the given size, mapped on a ball; its shell beyond the unit ball if hollow."""
    mesh = SPACE_FAMILIES["tetrahedra"](n, ((-size, size),) * 3)
    far, length = np.abs(mesh.points).max(axis=1), np.linalg.norm(mesh.points, axis=1)
    kept = np.abs(mesh.centroids).max(axis=1) > (1.0 if hollow else -1.0)
    cells = [cell for cell, keep in zip(mesh.cells, kept, strict=True) if keep]
    used = np.unique(np.concatenate([np.concatenate(cell) for cell in cells]))
    number = np.zeros(mesh.n_nodes, dtype=int)
    number[used] = np.arange(len(used))
    points = mesh.points * np.divide(far, length, out=np.ones_like(far), where=length > 0)[:, None]
    return vx.PolyhedralMesh(points[used], [[number[face] for face in cell] for cell in cells])


CURVED = {
    "pin in lug": (ring([0.4, 1.0], 16, 2), lambda alike: ring([1.0, 2.0], 16 if alike else 24, 3)),
    "ball in socket": (rounded(4, 1.0), lambda alike: rounded(8 if alike else 12, 2.0, hollow=True)),
}


LONGER_WAYS = ("pin in lug", True), ("ball in socket", False), ("ball in socket", True)


@mostly_long("kind, backwards", [("pin in lug", False), *LONGER_WAYS])
def test_one_polyhedron_of_a_curved_surface_matches_and_two_are_refused(kind, backwards):
    """Layers of pin and lug differ; the turned lug has nodes in the middle of the pin's sides."""
    first, second = CURVED[kind]

    def joined(other, **how):
        return bodies(dict(sorted({"a": first, "b": other}.items(), reverse=backwards)), **how)

    mesh = joined(second(True))
    x = first.points[first.face_vertices]
    on = np.abs((np.linalg.norm(x[:, :2], axis=1) if "pin" in kind else np.linalg.norm(x, axis=1)) - 1.0) < 1e-9
    outer = first.boundaries["boundary"]
    inner = outer[np.logical_and.reduceat(on, first.face_offsets[:-1])[outer]]
    assert_matched(mesh, first.face_areas[inner].sum())
    turned_lug = [turned(second(True), np.pi / 16, (0.0, 0.0))] if "pin" in kind else []
    for other in (second(False), *turned_lug):
        for tolerance in (None, 1e-3, 0.03):
            with pytest.raises(vx.MeshError, match="[Gg]ive both bodies the same nodes|give a smaller tolerance="):
                joined(other, tolerance=tolerance)


@mostly_long("family", FAMILIES, "tetrahedra")
def test_a_crack_inside_a_body(family):
    """From the left side to the middle: nodes along its front stay single; both lips have the same places."""
    whole = SPACE_FAMILIES[family](3 if family == "kelvin" else 4, seed=1)
    whole = whole.with_boundary("half", lambda x: x[:, 0] < 0.5)
    near = whole.centroids[:, 0] < 0.5
    above = near & (whole.centroids[:, 2] > 0.5)
    mesh = whole.cut("crack", {"upper lip": above, "lower lip": np.flatnonzero(near & ~above)})
    found = mesh.interfaces["crack"]
    assert found.bodies == ("upper lip", "lower lip")
    pairs = found.pairs
    np.testing.assert_array_equal(mesh.points[pairs[:, 0]], mesh.points[pairs[:, 1]])
    single = pairs[:, 0] == pairs[:, 1]
    assert 0 < single.sum() < len(pairs)
    assert mesh.n_nodes == whole.n_nodes + (~single).sum()
    np.testing.assert_array_equal(mesh.points[: whole.n_nodes], whole.points)
    for one, other in zip(mesh.cells, whole.cells, strict=True):
        for face, before in zip(one, other, strict=True):
            np.testing.assert_array_equal(
                *(np.unique(places, axis=0) for places in (mesh.points[face], whole.points[before]))
            )
    for name in ("left", "half", "right", "top"):
        np.testing.assert_array_equal(
            mesh.face_centroids[mesh.boundaries[name]], whole.face_centroids[whole.boundaries[name]]
        )
    assert len(mesh.boundaries["boundary"]) == len(whole.boundaries["boundary"]) + 2 * len(found.edges)
    again = vx.PolyhedralMesh(mesh.points, mesh.cells, interfaces=mesh.interfaces)
    assert_same(again, mesh, arrays=("points", "face_offsets", "face_vertices", "cell_faces"), parts=())
    if family != "tetrahedra":
        return
    finer = mesh.refine(mesh.centroids[:, 0] < 0.7)
    vx.PolyhedralMesh(finer.points, finer.cells, interfaces=finer.interfaces)
    areas = [one.face_areas[one.boundaries["crack"]].sum() for one in (mesh, finer)]
    assert areas[0] == pytest.approx(areas[1], rel=1e-12)


def test_a_crack_may_be_cut_before_or_after_extrusion():
    plane = small("voronoi", 5, seed=2)
    x, y = plane.centroids.T
    sides = {"above": (x < 0.6) & (y > 0.4), "below": (x < 0.6) & (y < 0.4)}
    before = plane.cut("crack", sides).extruded([0.0, 0.3, 0.5])
    then = plane.extruded([0.0, 0.3, 0.5]).cut("crack", {name: np.tile(cells, 2) for name, cells in sides.items()})
    assert before.n_nodes == then.n_nodes
    lips = [np.unique(mesh.face_centroids[mesh.boundaries["crack"]].round(12), axis=0) for mesh in (before, then)]
    np.testing.assert_array_equal(*lips)
    pairs = [mesh.points[mesh.interfaces["crack"].pairs] for mesh in (before, then)]
    np.testing.assert_array_equal(*(np.unique(places, axis=0) for places in pairs))


def test_cuts_right_through_are_the_mesh_of_bodies():
    mesh = cubes(4)
    right, back = (mesh.centroids[:, axis] > 0.5 for axis in (0, 1))
    parted = mesh.cut("joint", {"left": ~right, "right": right})
    joined = bodies(
        {"left": cubes((2, 4, 4), ((0, 0.5), (0, 1), (0, 1))), "right": cubes((2, 4, 4), ((0.5, 1), (0, 1), (0, 1)))}
    )
    assert parted.face_areas[parted.boundaries["joint"]].sum() == 1.0
    assert joined.face_areas[joined.boundaries["left|right"]].sum() == 1.0
    assert parted.n_nodes == joined.n_nodes
    # Across the joint, where the nodes stay double, a second cut meets it: the four quarters share no node.
    quarters = parted.cut("west", {"a": ~right & back, "b": ~right & ~back}).cut(
        "east", {"c": right & back, "d": right & ~back}
    )
    assert quarters.n_nodes == 4 * 3 * 3 * 5
    again = vx.PolyhedralMesh(quarters.points, quarters.cells, interfaces=quarters.interfaces)
    assert_same(again, quarters, arrays=("points", "face_vertices"), parts=())


def three_bodies():
    return bodies(
        {
            "größe <&:/>": SPACE_FAMILIES["tetrahedra"](2).with_cell_data("E", np.arange(48.0)),
            "middle": cubes(3, ((1, 2), (0.25, 1.5), (0, 1))),
            "right": SPACE_FAMILIES["voronoi3"](3, ((2, 3), (-1, 1), (0, 1))),
        },
        interfaces={"joint: a|b": ("right", "middle")},
    )


@pytest.mark.long
def test_files_pickles_and_pyvista_keep_interfaces(tmp_path):
    mesh = three_bodies()
    assert_matched(mesh)
    mesh.write(tmp_path / "mesh.vtu")
    assert_same(mesh, vx.meshes.read(tmp_path / "mesh.vtu"))
    assert_same(mesh, pickle.loads(pickle.dumps(mesh)))
    pytest.importorskip("pyvista")
    assert_same(mesh, vx.meshes.convert(mesh.to("pyvista")))


def test_names_data_and_predicates_leave_interfaces_alone():
    mesh = three_bodies().with_boundary("all", lambda x: np.ones(len(x), dtype=bool))
    sides = sum(2 * len(found.edges) for found in mesh.interfaces.values())
    assert len(mesh.boundaries["all"]) == len(mesh.boundaries["boundary"]) - sides
    np.testing.assert_array_equal(np.bincount(mesh.cell_data["body"]), [48, 3 * 4 * 3, 6 * 3 * 3])
    assert mesh.cell_data["E"][48:].max() == 0.0
    for name in ("größe <&:/>.right", "middle.left"):
        faces = mesh.boundaries[name]
        assert not np.isin(faces, np.concatenate([mesh.boundaries[joint] for joint in mesh.interfaces])).any()
    with pytest.raises(vx.MeshError, match=r"'joint: a\|b' is an interface of this mesh"):
        mesh.with_boundary("joint: a|b", lambda x: x[:, 0] > 0)


APART = ((1.0, 2.0), (0.0, 1.0), (0.0, 1.0))


def quarter(radii, sectors):
    """A quarter of a tube; two of unequal sides cross."""
    return vx.meshes.ring(radii, sectors, angles=(0.0, 0.5 * np.pi)).extruded([0.0, 0.4])


def test_invalid_sets_of_bodies_are_refused():
    a, far = cubes(1), cubes(1, ((5, 6), (0, 1), (0, 1)))
    beside = turned(cubes(1, ((1.2, 2.2), (0, 1), (0.2, 0.8))), np.pi / 4, (1.2, 0.5))
    tubes = {"a": quarter([0.9, 1.0], 8), "b": quarter([1.0, 1.1], 6)}
    for meshes, options, subject in (
        ({"a": a, "b": cubes(1)}, {}, r"'a' and 'b' overlap near \("),
        ({"a": a, "b": cubes(2, ((0.5, 1.5), (0, 1), (0, 1)))}, {}, r"'a' and 'b' overlap near \(0\.5"),
        ({"a": a, "b": cubes(2, ((0.2, 0.8), (0.2, 0.8), (0.2, 0.8)))}, {}, "'a' and 'b' overlap near"),
        ({"a": a, "b": cubes(2, ((0.2, 0.8), (0.2, 0.8), (0.2, 1.0)))}, {}, "'a' and 'b' overlap near"),
        (tubes, {}, "'a' and 'b' overlap near .* give both bodies the same nodes there"),
        ({"a": a, "b": cubes(1, ((1, 2), (1, 2), (0, 1)))}, {}, r"touch only in an edge .* near \(1, 1, 0\)"),
        ({"a": a, "b": cubes(1, ((1, 2), (1, 2), (1, 2)))}, {}, r"touch only in an edge .* near \(1, 1, 1\)"),
        ({"a": a, "b": cubes(1, ((0.2, 0.8), (1, 2), (1, 2)))}, {}, "touch only in an edge"),
        ({"a": a, "b": beside}, {}, "'a' and 'b' (touch only|overlap)"),
        ({"a": a, "b": cubes(1, ((1 + 1e-7, 2), (0, 1), (0, 1)))}, {}, "are 1e-07 apart near"),
        ({"a": a, "b": vx.meshes.squares(1)}, {}, "some meshes are in the plane, and some in space"),
        ({"a": a, "b": cubes(2, APART), "c": far}, {"interfaces": {"joint": ("a", "c")}}, "'joint' .*faces: 'a.b'"),
        ({"ab": bodies({"a": a, "b": cubes(2, APART)}), "c": far}, {}, "already has interfaces"),
        ({"a": a, "b": cubes(1, ((1, 1.2), (0, 1), (0, 1)))}, {"tolerance": 0.3}, r"near \(.* move to the same place"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            bodies(meshes, **options)
    apart = bodies({"a": a, "b": far})
    assert not apart.interfaces
    assert apart.n_nodes == 16
    for sides, subject in (
        ({"a": [0], "b": [63]}, "the cells of 'a' and 'b' have no face in common"),
        ({"a": [21], "b": [22]}, r"the face at \(0\.5, 0\.375, 0\.375\) has a tip at all its nodes"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            cubes(4).cut("crack", sides)


def test_wrong_interfaces_are_refused():
    mesh = bodies({"a": cubes(1), "b": cubes(1, APART)})
    found = mesh.interfaces["a|b"]
    for change, message in (
        (
            {"edges": found.edges[:, [0, 2, 1, 3]][:, :3], "partners": found.partners[:, [0, 2, 1, 3]][:, :3]},
            "same place",
        ),
        (
            {
                "edges": np.append(found.edges, [[0, 1, 2, -1]], axis=0),
                "partners": np.append(found.partners, [[0, 1, 2, -1]], axis=0),
            },
            r"\(0, 1, 2\) is not a face of the boundary",
        ),
        ({"partners": found.partners[:0]}, "faces must be rows"),
        ({"partners": found.partners[:, ::-1][:, [1, 2, 3, 0]]}, "nodes 1 and 14 are partners .* but lie at"),
        ({"edges": found.edges + 100}, r"faces must be rows .* of three nodes or more, .* numbered 0 to 15"),
    ):
        with pytest.raises(vx.MeshError, match=message):
            vx.PolyhedralMesh(mesh.points, mesh.cells, interfaces={"a|b": replace(found, **change)})
    with pytest.raises(vx.MeshError, match=r"in the same place, .* join them with vx\.meshes\.bodies"):
        vx.PolyhedralMesh(mesh.points, mesh.cells)
