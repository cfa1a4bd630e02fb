"""Meshes of polyhedra: faults that are refused or corrected, and valid meshes of unusual shape."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from refined_cubes import refined_cubes

import vemcvx as vx
from vemcvx.meshes import PolyhedralMesh

CUBE = [(x, y, z) for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)]
FACES = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
NEXT = [(2.0, y, z) for z in (0.0, 1.0) for y in (0.0, 1.0)]  # nodes 8 to 11 of a second cube on the right
RIGHT = [[1, 5, 7, 3], [8, 9, 11, 10], [1, 8, 10, 5], [3, 7, 11, 9], [1, 3, 9, 8], [5, 10, 11, 7]]
TETRAHEDRON = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]


def make_cube(low=(0, 0, 0), width=1.0, first=0):
    """Return points and faces of a cube, with nodes numbered from `first`."""
    return [tuple(np.add(low, width * np.array(p))) for p in CUBE], [[first + k for k in face] for face in FACES]


def assert_refused(points, cells, message):
    with pytest.raises(vx.MeshError, match=message):
        PolyhedralMesh(points, cells)


GEOMETRY = [
    ([*CUBE[:7], CUBE[5]], [FACES], "nodes 5 and 7 are in the same place"),
    (CUBE, [[*FACES, FACES[2][::-1]]], r"cell 0 is not closed, .*: its edge \(0, 1\) belongs to 3 of its faces"),
    (CUBE, [FACES[:5]], r"cell 0 is not closed, .*: its edge \(4, 5\) belongs to 1 of its faces"),
    (CUBE, [[[0, 4, 2, 6], *FACES[1:]]], r"cell 0: its face 0 \(0, 4, 2, 6\) has no area"),
    ([*CUBE[:7], (1.0, 1.0, 1.2)], [FACES], r"cell 0: its face \d .* is not plane: node \d lies .* off its plane"),
    ([*CUBE, (0.5, 0.0, 0.0)], [[[0, 8, 4, 6, 2], *FACES[1:]]], "is not plane|not closed"),
    ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0.2, 0.2, 0)], [TETRAHEDRON], "cell 0 has no volume"),
    ([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 0, 1)], [TETRAHEDRON], r"cell 0: its face 0 \(0, 2, 1\) has no area"),
    ([*CUBE, *NEXT], [FACES, RIGHT, RIGHT], r"cells 0, 1, 2 overlap at their face"),
    ([*CUBE, *NEXT], [FACES, [[1, 7, 5, 3], *RIGHT[1:]]], r"cell 1 is not closed, .*: its edge \(1, 5\) belongs to 1"),
    # The right cube has two triangles instead of the common square.
    (
        [*CUBE, *NEXT],
        [FACES, [*RIGHT[1:], [1, 5, 7], [1, 7, 3]]],
        r"the face \(1, 3, 7, 5\) of cell 0 and the face \(1, 5, 7\) of cell 1 lie on one another",
    ),
]


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_invalid_cells_are_refused(scale):
    for points, cells, subject in GEOMETRY:
        assert_refused(scale * np.array(points, dtype=float), cells, subject)


def join(*blocks):
    """Return points and cells of blocks that share no node."""
    points, cells = [], []
    for nodes, faces in blocks:
        cells.append([[len(points) + k for k in face] for face in faces])
        points += nodes
    return points, cells


MEET_IN_PART = r"the face \(1, 3, 7, 5\) of cell 0 and the face \(8, 12, 14, 10\) of cell 1 lie on one another"
CROSS = ([(x, y, z) for z in (0.0, 1.0) for y in (1.0, 2.0) for x in (0.0, 3.0)], FACES)
CROSS = CROSS, ([(x, y, z) for z in (1.0, 2.0) for y in (0.0, 3.0) for x in (1.0, 2.0)], FACES)


@pytest.mark.parametrize("offset", [0.0, 100.0])
def test_cells_that_do_not_fit_together_are_refused(offset):
    """Test a cube in another cube, adjacent cubes without common nodes, and two bars that cross."""
    for blocks, subject in (
        (
            [make_cube(), make_cube((0.25, 0.25, 0.25), 0.5)],
            "volumes add up to 1.125, but the convex hull .* has only 1",
        ),
        ([make_cube((0.25, 0.25, 0.25), 0.5), make_cube()], "cells overlap: their volumes add up to 1.125"),
        ([make_cube(), make_cube((1.0, 0.25, 0.25), 0.5)], MEET_IN_PART),
        ([make_cube(), make_cube((1.0 + 1e-8, 0.25, 0.25), 0.5)], MEET_IN_PART),
        ([make_cube(), make_cube((1.0, 0.5, 0.0))], MEET_IN_PART),
        (CROSS, "of cell 0 and the face .* of cell 1 lie on one another"),
    ):
        points, cells = join(*blocks)
        assert_refused(np.array(points) + offset, cells, subject)


def make_prism(*profile):
    """Return points and faces of a prism over a polygon."""
    n = len(profile)
    points = np.array([(*place, z) for z in (0.0, 1.0) for place in profile], dtype=float)
    sides = [[k, (k + 1) % n, (k + 1) % n + n, k + n] for k in range(n)]
    return points, [[list(range(n))[::-1], list(range(n, 2 * n)), *sides]]


def test_cells_that_cross_or_touch_themselves_or_have_no_inside_are_refused():
    """Test a prism with a crossing outline, a ring that touches itself, a cavity, and a one-sided surface."""
    crossing = make_prism((0, 0), (3, 0), (3, 1), (1, 1), (1, -1), (2, -1), (2, 2), (0, 2))
    ring = [(0, 0), (4, 0), (4, 3), (2, 3), (2, 2), (3, 2), (3, 1), (1, 1), (1, 2), (2, 2.5), (1, 3), (0, 3)]
    for points, cells in (crossing, make_prism(*ring)):
        assert_refused(points, cells, r"cell 0: its face \d \(.*\) crosses or touches itself")
    inner, faces = make_cube((0.25, 0.25, 0.25), 0.5, first=8)
    hollow = [*FACES, *(face[::-1] for face in faces)]
    assert_refused([*CUBE, *inner], [hollow], "faces of cell 0 do not form one closed surface")
    triangles = "012 023 034 045 051 124 235 341 452 513"
    faces = [list(map(int, triangle)) for triangle in triangles.split()]
    assert_refused(np.random.default_rng(0).random((6, 3)), [faces], "faces of cell 0 do not form one closed surface")


@pytest.mark.parametrize("reversed_faces", [(0,), range(6), (0, 1, 2, 5)], ids=str)
def test_faces_that_run_inwards_are_reversed_with_a_warning(reversed_faces):
    cells = [[face[::-1] if k in reversed_faces else face for k, face in enumerate(FACES)], RIGHT]
    with pytest.warns(
        vx.MeshWarning, match=r"1 of 2 cells had faces with clockwise vertices.*the first is cell 0"
    ) as caught:
        mesh = PolyhedralMesh([*CUBE, *NEXT], cells)
    assert caught[0].filename == __file__
    np.testing.assert_array_equal(mesh.volumes, 1.0)
    assert (mesh.face_normals[0] == (-1, 0, 0)).all()
    assert mesh.face_cells[1].tolist() == [0, 1]
    assert (mesh.face_normals[1] == (1, 0, 0)).all()


def assert_valid(points, cells, volume):
    """Check the volume of a mesh, and return the mesh."""
    mesh = PolyhedralMesh(points, cells)
    assert mesh.volumes.sum() == pytest.approx(volume, rel=1e-14)
    return mesh


def test_holes_and_separate_parts_are_valid():
    mesh = vx.meshes.cubes(3)
    shell = assert_valid(mesh.points, [cell for c, cell in enumerate(mesh.cells) if c != 13], 26 / 27)
    assert len(shell.boundaries["boundary"]) == 60
    inner, faces = make_cube((0.4, 0.4, 0.4), 0.2, first=64)
    assert_valid([*shell.points.tolist(), *inner], [*shell.cells, faces], 26 / 27 + 0.008)
    points, cells = join(make_cube(), make_cube((3, 0, 0)), make_cube((0, 0.5, 7)))
    assert_valid(points, cells, 3.0)


def test_cells_that_meet_in_an_edge_or_a_point_are_valid():
    grid = vx.meshes.cubes(2)
    for chosen in ((0, 3), (0, 7), (0, 3, 5, 6)):
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*nodes belong to no cell")
            assert_valid(grid.points, [grid.cells[c] for c in chosen], len(chosen) / 8)
    mesh = assert_valid(*make_prism((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)), 3.0)
    np.testing.assert_allclose(mesh.centroids[0], [5 / 6, 5 / 6, 0.5])


def test_points_in_single_precision_are_valid():
    for name in ("cubes", "tetrahedra", "kelvin"):
        mesh = vx.meshes.SPACE_FAMILIES[name](2, ((0.1, 1.3), (-0.7, 0.9), (0.3, 1.1)))
        rotation = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
        rotation *= np.linalg.det(rotation)
        points = (mesh.points @ rotation).astype(np.float32)
        assert PolyhedralMesh(points, mesh.cells).volumes.sum() == pytest.approx(1.2 * 1.6 * 0.8, rel=1e-6)


def test_tiny_edges_are_valid():
    """Cut a corner of the size 1e-6 or 1e-10 off the unit cube."""
    for tiny in (1e-6, 1e-10):
        points = [*CUBE[:7], (1 - tiny, 1, 1), (1, 1 - tiny, 1), (1, 1, 1 - tiny)]
        faces = [FACES[0], [1, 3, 9, 8, 5], FACES[2], [2, 6, 7, 9, 3], FACES[4], [4, 5, 8, 7, 6], [7, 8, 9]]
        assert_valid(points, [faces], 1.0 - tiny**3 / 6)


def test_flat_cells_and_cells_in_arrays_are_valid():
    mesh = vx.meshes.tetrahedra((3, 3, 1), ((0, 1), (0, 1), (0, 1e-7)))
    assert_valid(mesh.points, mesh.cells, 1e-7)
    assert PolyhedralMesh([*CUBE, *NEXT], np.array([FACES, RIGHT], dtype=np.uint8)).n_faces == 11


@pytest.mark.long
def test_cells_damaged_at_random_are_refused_or_valid():
    """Meshes with a damaged cell are refused, or have closed cells with positive volumes."""
    rng = np.random.default_rng(1)
    meshes = [make(2, seed=2) for make in vx.meshes.SPACE_FAMILIES.values()] + [refined_cubes(2)]
    count = 0
    for trial in range(120):
        mesh = meshes[trial % len(meshes)]
        points, cells = mesh.points.copy(), [[face.tolist() for face in cell] for cell in mesh.cells]
        damage(points, cells, rng)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", vx.MeshWarning)
                again = PolyhedralMesh(points, cells)
        except vx.MeshError:
            count += 1
        else:
            assert (again.volumes > 0.0).all()
            vectors = (again.face_areas[:, None] * again.face_normals)[again.cell_faces] * again.face_signs[:, None]
            closed = np.add.reduceat(vectors, again.cell_offsets[:-1], axis=0)
            np.testing.assert_allclose(closed, 0.0, atol=1e-6)
    assert 60 < count < 120


def damage(points, cells, rng):
    """Change or remove a point, a face or a cell in place."""
    cell = cells[rng.integers(len(cells))]
    face = cell[rng.integers(len(cell))]
    at, other = int(rng.integers(len(face))), int(rng.integers(-2, len(points) + 2))
    shifted = points[face[at]] + rng.normal(scale=10.0 ** rng.integers(-12, 1), size=3)
    ways = (
        *(lambda: cell.remove(face), lambda: cell.append(face[::-1]), lambda: cells.append(cell)),
        *(lambda: cells.remove(cell), lambda: face.pop(at), face.reverse, lambda: face.insert(at, other)),
        *(lambda: face.append(face.pop(0)), lambda: face.insert(0, face.pop(1))),
        *(
            lambda: np.copyto(points[face[at]], shifted),
            lambda: np.copyto(points[face[at]], points[other % len(points)]),
        ),
    )
    ways[rng.integers(len(ways))]()


def test_boundaries_are_given_by_face_numbers_or_by_vertices():
    mesh = PolyhedralMesh(
        CUBE, [FACES], boundaries={"sides": [0, 1], "base": [[3, 1, 0, 2]], "some": [[0, 4, 6, 2], (4, 5, 7, 6)]}
    )
    assert {name: faces.tolist() for name, faces in mesh.boundaries.items()} == {
        "sides": [0, 1],
        "base": [4],
        "some": [0, 5],
        "boundary": [0, 1, 2, 3, 4, 5],
    }
    assert all(not faces.flags.writeable for faces in mesh.boundaries.values())
