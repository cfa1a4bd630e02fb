"""What every family of meshes in space must do, and what each promises of its own."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.meshes import SPACE_FAMILIES

SIDES = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1), "bottom": (2, 0), "top": (2, 1)}
ODD_BOX = ((-1.0 / 3.0, np.pi), (0.1, 0.7), (-5.0, -4.0))
SLENDER_AND_FAR = ((1e5, 1e5 + 2.0), (-3e5, -3e5 + 0.5), (0.0, 0.5))
BOXES = {"unit": ((0, 1), (0, 1), (0, 1)), "odd": ODD_BOX, "far": SLENDER_AND_FAR}
COUNTS = [1, 2, 3, (1, 2, 3), (4, 1, 1)]
RANDOM = ("prisms", "voronoi3")


@pytest.fixture(params=SPACE_FAMILIES)
def make(request):
    return SPACE_FAMILIES[request.param]


@cache
def made(family, n, box):
    """A mesh that several tests look at, drawn with a seed that depends on its box."""
    return family(n, box, sorted(BOXES.values()).index(box))


def spacing(box):
    """What coordinates are rounded to, in parts of the shortest side."""
    shortest = np.diff(box).min()
    return 2.0**-53 * np.abs(box).max() / shortest


@pytest.mark.parametrize("box", BOXES.values(), ids=BOXES)
@pytest.mark.parametrize("n", COUNTS, ids=str)
def test_cells_fill_the_box(make, n, box):
    mesh = made(make, n, box)
    lengths = np.diff(box)[:, 0]
    assert (mesh.volumes > 0.0).all()
    rounding = 100.0 * spacing(box) + 1e-15 * mesh.n_cells
    assert mesh.volumes.sum() == pytest.approx(np.prod(lengths), rel=rounding)
    inside = (mesh.volumes[:, None] * (mesh.centroids - np.mean(box, axis=1))).sum(axis=0) / mesh.volumes.sum()
    np.testing.assert_allclose(inside, 0.0, atol=rounding * lengths.max())


@pytest.mark.parametrize("n", COUNTS, ids=str)
def test_area_vectors_of_a_cell_add_up_to_zero(make, n):
    mesh = made(make, n, ODD_BOX)
    vectors = (mesh.face_areas[:, None] * mesh.face_normals)[mesh.cell_faces] * mesh.face_signs[:, None]
    total = np.add.reduceat(vectors, mesh.cell_offsets[:-1], axis=0)
    np.testing.assert_allclose(total, 0.0, atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(mesh.face_normals, axis=1), 1.0, rtol=1e-15)


@pytest.mark.parametrize("n", COUNTS, ids=str)
def test_normals_point_out_of_the_first_cell_into_the_second(make, n):
    mesh = made(make, n, ODD_BOX)
    first, second = mesh.face_cells.T
    inner = second >= 0
    outward = np.einsum("ij,ij->i", mesh.face_centroids - mesh.centroids[first], mesh.face_normals)
    assert (outward > 0.0).all()  # cells of all families are convex
    inward = np.einsum("ij,ij->i", (mesh.face_centroids - mesh.centroids[second])[inner], mesh.face_normals[inner])
    assert (inward < 0.0).all()
    assert (first[inner] < second[inner]).all()


@pytest.mark.parametrize("n", COUNTS, ids=str)
def test_cells_and_faces_know_each_other(make, n):
    mesh = made(make, n, ODD_BOX)
    owner = np.repeat(np.arange(mesh.n_cells), np.diff(mesh.cell_offsets))
    told = {(int(c), int(f)) for c, f in zip(owner, mesh.cell_faces, strict=True)}
    assert told == {(int(c), f) for f, pair in enumerate(mesh.face_cells) for c in pair if c >= 0}
    assert len(told) == len(mesh.cell_faces)


@pytest.mark.parametrize("box", BOXES.values(), ids=BOXES)
@pytest.mark.parametrize("n", COUNTS, ids=str)
def test_sides_are_named_and_exact(make, n, box):
    mesh = made(make, n, box)
    lengths = np.diff(box)[:, 0]
    assert list(mesh.boundaries) == [*SIDES, "boundary"]
    for name, (axis, end) in SIDES.items():
        faces = mesh.boundaries[name]
        for face in faces:
            vertices = mesh.face_vertices[mesh.face_offsets[face] : mesh.face_offsets[face + 1]]
            assert (mesh.points[vertices, axis] == box[axis][end]).all()
        np.testing.assert_array_equal(
            mesh.face_normals[faces], np.tile(np.eye(3)[axis] * (2 * end - 1), (len(faces), 1))
        )
        area = np.prod(np.delete(lengths, axis))
        assert mesh.face_areas[faces].sum() == pytest.approx(area, rel=100.0 * spacing(box) + 1e-15 * len(faces))
    assert sum(len(mesh.boundaries[name]) for name in SIDES) == len(mesh.boundaries["boundary"])


def test_corners_of_the_box_are_nodes(make):
    points = {tuple(point) for point in make(2, ODD_BOX).points}
    assert {(x, y, z) for x in ODD_BOX[0] for y in ODD_BOX[1] for z in ODD_BOX[2]} <= points


def test_arrays_are_read_only(make):
    mesh = make(1)
    for name in ("points", "face_offsets", "face_vertices", "cell_offsets", "cell_faces", "face_cells"):
        assert not getattr(mesh, name).flags.writeable
    for name in ("face_areas", "face_normals", "face_centroids", "volumes", "centroids", "diameters"):
        assert not getattr(mesh, name).flags.writeable


@pytest.mark.parametrize("n", [1, 2, (1, 2, 3)], ids=str)
def test_nodes_of_cells(make, n):
    mesh = make(n)
    offsets, nodes = mesh.cell_nodes
    for cell in range(mesh.n_cells):
        faces = mesh.cell_faces[mesh.cell_offsets[cell] : mesh.cell_offsets[cell + 1]]
        named = [mesh.face_vertices[mesh.face_offsets[f] : mesh.face_offsets[f + 1]] for f in faces]
        np.testing.assert_array_equal(nodes[offsets[cell] : offsets[cell + 1]], np.unique(np.concatenate(named)))
        corners = mesh.points[nodes[offsets[cell] : offsets[cell + 1]]]
        distances = np.linalg.norm(corners[:, None] - corners, axis=2)
        assert mesh.diameters[cell] == pytest.approx(distances.max(), rel=1e-15)


def test_n_is_cells_across_the_shortest_side(make):
    for box, nx, ny, nz in ((((0, 1), (0, 1), (0, 1)), 3, 3, 3), (((0, 2), (0, 0.5), (0, 1)), 12, 3, 6)):
        per_cube = {"tetrahedra": 6 * nx * ny * nz, "kelvin": nx * ny * nz + (nx + 1) * (ny + 1) * (nz + 1)}
        assert make(3, box).n_cells == per_cube.get(make.__name__, nx * ny * nz)


def test_cells_of_a_size(make):
    box = ((0.0, 40.0), (-10.0, 0.0), (0.0, 20.0))
    sized, counted = make(size=5.0, box=box), make(2, box)
    np.testing.assert_array_equal(sized.points, counted.points)
    np.testing.assert_array_equal(sized.face_vertices, counted.face_vertices)


def test_same_seed_same_mesh(make):
    one, same, other = make(3, seed=5), make(3, seed=5), make(3, seed=6)
    np.testing.assert_array_equal(one.points, same.points)
    np.testing.assert_array_equal(one.cell_faces, same.cell_faces)
    differs = one.points.shape != other.points.shape or not np.array_equal(one.points, other.points)
    assert differs == (make.__name__ in RANDOM)


def heights(mesh, nodes, faces):
    """How far nodes lie above the planes of faces, and the diameters of these."""
    return np.einsum("ij,ij->i", mesh.points[nodes] - mesh.face_centroids[faces], mesh.face_normals[faces])


@pytest.mark.parametrize("n", COUNTS, ids=str)
@pytest.mark.parametrize("box", BOXES.values(), ids=BOXES)
def test_faces_are_plane_and_cells_convex(make, n, box):
    """Up to the rounding of the coordinates, which tilts the plane of a small face by its part of the face."""
    mesh = made(make, n, box)
    longest = np.diff(box).max()
    faces = np.repeat(np.arange(mesh.n_faces), np.diff(mesh.face_offsets))
    rounding = 1e-15 * longest + 2.0**-52 * np.abs(box).max()
    size = np.sqrt(mesh.face_areas)
    plane = np.abs(heights(mesh, mesh.face_vertices, faces))
    assert (plane <= 20.0 * rounding * np.maximum(1.0, longest / size)[faces]).all()
    offsets, nodes = mesh.cell_nodes
    counts = np.diff(offsets)[np.repeat(np.arange(mesh.n_cells), np.diff(mesh.cell_offsets))]
    own = np.repeat(mesh.cell_faces, counts)
    sign = np.repeat(mesh.face_signs, counts)
    cell = np.repeat(np.arange(mesh.n_cells), np.diff(mesh.cell_offsets))
    inside = np.concatenate([nodes[offsets[c] : offsets[c + 1]] for c in cell])
    bulge = sign * heights(mesh, inside, own)
    assert (bulge <= 20.0 * rounding * np.maximum(1.0, longest / size)[own]).all()


def test_the_size_of_a_cube_and_of_a_tetrahedron():
    assert vx.meshes.cubes(4).h == pytest.approx(np.sqrt(3.0) / 4.0, rel=1e-15)
    assert vx.meshes.tetrahedra(4).h == pytest.approx(np.sqrt(3.0) / 4.0, rel=1e-15)
    np.testing.assert_allclose(vx.meshes.tetrahedra(2).volumes, 1.0 / 48.0, rtol=1e-14)


def test_kelvin_cells_are_truncated_octahedra():
    mesh = vx.meshes.kelvin((2, 3, 4), ((0, 2), (0, 3), (0, 4)))
    middle, corner = mesh.volumes[:24], mesh.volumes[24:]
    np.testing.assert_allclose(middle, 0.5, rtol=1e-14)
    assert corner.min() == pytest.approx(0.5 / 8)
    assert corner.max() == pytest.approx(0.5)
    assert (np.diff(mesh.cell_offsets)[:24] == 14).all()
    sides = np.sort(np.diff(mesh.face_offsets)[mesh.cell_faces[: 24 * 14]].reshape(24, 14), axis=1)
    np.testing.assert_array_equal(sides, np.tile([4] * 6 + [6] * 8, (24, 1)))
    edge = np.sqrt(2.0) / 4.0
    np.testing.assert_allclose(mesh.diameters[:24], np.sqrt(10.0) * edge, rtol=1e-14)


def test_voronoi_cells_are_nearest_to_their_seeds():
    """Without relaxation, every vertex is as near to the seeds of its cells, and to no seed nearer."""
    count = 40
    mesh = vx.meshes.voronoi3(cells=count, seed=3, relaxations=0)
    seeds = np.random.default_rng(3).random((count, 3))
    distance = np.linalg.norm(mesh.points[:, None] - seeds, axis=2)
    nearest = [set(np.flatnonzero(row < row.min() + 1e-12)) for row in distance]
    offsets, nodes = mesh.cell_nodes
    owned = [set() for _ in nearest]
    for cell in range(count):
        for node in nodes[offsets[cell] : offsets[cell + 1]]:
            owned[node].add(cell)
    inner = np.argmin(np.linalg.norm(mesh.centroids[:, None] - seeds, axis=2), axis=1)
    assert sorted(inner) == sorted(set(inner))
    for node, cells in enumerate(owned):
        assert len(cells) == len(nearest[node])


@pytest.mark.long
def test_relaxed_voronoi_cells_are_rounder():
    raw, relaxed = (vx.meshes.voronoi3(4, seed=1, relaxations=k) for k in (0, 10))
    assert relaxed.volumes.std() < 0.5 * raw.volumes.std()
    assert relaxed.h < raw.h


@pytest.mark.long
def test_voronoi_cells_of_any_box_are_a_valid_mesh():
    rng = np.random.default_rng(5)
    for seed in range(12):
        low, lengths = rng.normal(size=3) * 10.0 ** rng.integers(-3, 4), 10.0 ** rng.uniform(-1.5, 1.5, size=3)
        box = tuple(zip(low.tolist(), (low + lengths).tolist(), strict=True))
        mesh = vx.meshes.voronoi3(cells=int(rng.integers(1, 60)), box=box, seed=seed, relaxations=int(rng.integers(3)))
        again = vx.PolyhedralMesh(mesh.points, mesh.cells)  # a warning would be an error here
        assert again.volumes.sum() == pytest.approx(np.prod(np.diff(box)), rel=1e-9)
        assert len(again.boundaries["boundary"]) == sum(len(mesh.boundaries[name]) for name in SIDES)


@pytest.mark.parametrize("cells", [1, 2, 3, 5, 17])
def test_voronoi_cells_of_a_number(cells):
    mesh = vx.meshes.voronoi3(cells=cells, box=ODD_BOX)
    assert mesh.n_cells == cells
    assert mesh.volumes.sum() == pytest.approx(np.prod(np.diff(ODD_BOX)), rel=1e-13)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"n": 0}, "n must be at least 1; got 0"),
        ({"n": 2.5}, "n must be a whole number; got 2.5"),
        ({"n": (2, 3)}, "n must be a whole number or a triple (nx, ny, nz); got (2, 3)"),
        ({"n": (2, 3, 0)}, "nz must be at least 1; got 0"),
        ({}, "n must be given (cells across the shortest side) or size="),
        ({"size": -1.0}, "size must be a length above 1e-60"),
        ({"n": 2, "box": ((0, 1), (0, 1))}, "box must be ((x0, x1), (y0, y1), (z0, z1)), six numbers; got"),
        ({"n": 2, "box": ((0, 1), (0, 1), (0, "1"))}, "box must be ((x0, x1), (y0, y1), (z0, z1)), six numbers; got"),
        ({"n": 2, "box": ((0, 1), (0, 1), (1, 1))}, "box must have z0 < z1; got z0 = 1 and z1 = 1"),
        ({"n": 2, "box": ((0, 1), (0, np.nan), (0, 1))}, "box must be finite"),
        ({"n": 2, "box": ((0, 1), (0, 1), (0, 1e99))}, "box must have sides above 1e-60"),
        ({"n": 10**4}, "that would be"),
    ],
    ids=str,
)
def test_bad_requests(make, given, says):
    with pytest.raises(vx.MeshError, match=re.escape(says)):
        make(**given)


@pytest.mark.parametrize("make", [vx.meshes.cubes, vx.meshes.tetrahedra, vx.meshes.kelvin])
def test_cells_narrower_than_the_spacing_of_numbers(make):
    with pytest.raises(vx.MeshError, match="narrower than the spacing of floating-point numbers"):
        make(size=0.25, box=((1e16, 1e16 + 2), (0, 1), (0, 1)))
