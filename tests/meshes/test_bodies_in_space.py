"""Several bodies in space in one mesh: matched interfaces, names and data, cracks, and refusals."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from same_mesh import assert_matched, measure_part
from scenes import mostly_slow, moved, rotation

import vemcvx as vx
from vemcvx.meshes import SPACE_FAMILIES, bodies, cubes

FAMILIES = list(SPACE_FAMILIES)
NEXT_DOOR = ((1.0, 2.0), (0.0, 1.0), (0.0, 1.0))


def ring(radii, sectors, levels):
    """Return a tube of hexahedra over the sectors of a ring."""
    return vx.meshes.ring(radii, sectors).extruded(np.linspace(0, 1, levels + 1))


def rotate(mesh, angle, about=(0.5, 0.5)):
    """Return the mesh rotated about a vertical axis."""
    matrix, axis = np.eye(3), np.array([*about, 0.0])
    matrix[:2, :2] = rotation(angle)
    return moved(mesh, matrix, axis - matrix @ axis)


@pytest.mark.long
@pytest.mark.parametrize("angle", [0.0, 0.4, np.pi / 4])
@pytest.mark.parametrize(("below", "above"), [*zip(FAMILIES, FAMILIES[1:] + FAMILIES[:1], strict=True)])
def test_rotated_blocks_of_two_families_match(below, above, angle):
    lower = SPACE_FAMILIES[below]((7, 7, 2), ((-1, 2), (-1, 2), (0, 1)), seed=1)
    upper = rotate(SPACE_FAMILIES[above]((5, 5, 2), ((0, 1), (0, 1), (1, 2)), seed=2), angle)
    for meshes in ({"lower": lower, "upper": upper}, {"upper": upper, "lower": lower}):
        mesh = bodies(meshes)
        assert_matched(mesh)
        assert measure_part(mesh, next(iter(mesh.interfaces))) == pytest.approx(1.0, abs=1e-9)
        np.testing.assert_allclose(mesh.volumes, np.concatenate([part.volumes for part in meshes.values()]), rtol=1e-12)
    assert set(mesh.boundaries) == {
        *(f"lower.{name}" for name in ("left", "right", "front", "back", "bottom", "top")),
        *(f"upper.{name}" for name in ("left", "right", "front", "back", "top")),
        *("upper|lower", "boundary"),
    }


def test_the_interface_of_two_grids_has_a_face_for_each_piece():
    mesh = bodies({"lower": cubes(7), "upper": cubes(5, ((0, 1), (0, 1), (1, 2)))})
    assert_matched(mesh)
    assert measure_part(mesh, "lower|upper") == pytest.approx(1.0, abs=1e-12)
    # Multiples of 1/7 and 1/5 divide each axis into eleven intervals.
    assert len(mesh.boundaries["lower|upper"]) == 11**2
    assert len(mesh.interfaces["lower|upper"].pairs) == 12**2
    assert mesh.n_cells == 7**3 + 5**3


def test_the_rest_of_a_face_around_a_block_is_split_into_triangles():
    """Put a block on the middle of a cube face. A face with a hole is not allowed."""
    mesh = bodies({"table": cubes(1), "box": cubes(2, ((0.3, 0.6), (0.3, 0.6), (1, 1.5)))})
    assert_matched(mesh)
    assert measure_part(mesh, "table|box") == pytest.approx(0.09, abs=1e-12)
    assert measure_part(mesh, "table.top") == pytest.approx(1 - 0.09, abs=1e-12)
    assert (np.diff(mesh.face_offsets)[mesh.boundaries["table.top"]] == 3).all()


@pytest.mark.long
def test_three_bodies_meet_along_an_edge():
    """Put a lid across the joint of two blocks."""
    blocks = {"left": SPACE_FAMILIES["tetrahedra"](2), "right": cubes(3, NEXT_DOOR)}
    lid = SPACE_FAMILIES["voronoi3"](3, ((0.3, 1.4), (0.2, 0.8), (1, 2)))
    mesh = bodies({**blocks, "lid": lid}, interfaces={"joint": ("right", "left")})
    assert_matched(mesh)
    assert sum(measure_part(mesh, name) for name in mesh.interfaces) == pytest.approx(1.0 + 1.1 * 0.6, abs=1e-9)
    assert {name: found.bodies for name, found in mesh.interfaces.items()} == {
        "joint": ("right", "left"),
        "left|lid": ("left", "lid"),
        "right|lid": ("right", "lid"),
    }


@pytest.mark.long
@mostly_slow("size", range(2, 14), 2, 6, 7)
def test_blocks_match_at_every_small_offset(size):
    """Shift one block by 10^-size. Pieces of the interface become narrow, and nodes less than 8e-9 apart are merged."""
    for k, (name, exponent) in enumerate(itertools.product(("cubes", "tetrahedra", "kelvin"), (0.0, 0.5))):
        x, y = 10.0 ** -(size + exponent) * np.random.default_rng([size, k]).normal(size=2)
        make = SPACE_FAMILIES[name]
        assert_matched(bodies({"a": make(2), "b": make(2, ((x, 1 + x), (y, 1 + y), (1, 2)))}))


def round_points(mesh):
    """Return the mesh with points rounded to seven decimals."""
    return vx.PolyhedralMesh(np.round(mesh.points, 7), mesh.cells)


@pytest.mark.long
def test_a_tolerance_matches_points_rounded_to_seven_digits():
    """Test a plane joint with different nodes, and a cylindrical joint with equal nodes."""
    lower = round_points(cubes(3, ((-1, 2), (-1, 2), (0, 1))))
    upper = round_points(rotate(SPACE_FAMILIES["tetrahedra"](3, ((0, 1), (0, 1), (1, 2))), 0.4))
    mesh = bodies({"lower": lower, "upper": upper}, tolerance=3e-7)
    assert measure_part(mesh, "lower|upper") == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(mesh.volumes, np.concatenate([lower.volumes, upper.volumes]), rtol=1e-5)
    pin, lug = round_points(ring([0.4, 1.0], 16, 2)), ring([1.0, 2.0], 16, 2)
    mesh = bodies({"pin": pin, "lug": lug}, tolerance=3e-7)
    assert measure_part(mesh, "pin|lug") == pytest.approx(32 * np.sin(np.pi / 16), rel=1e-7)


def test_cylinders_of_equal_sectors_match_and_others_are_refused():
    """Tubes with different layers along the axis match. Tubes with unequal or rotated sectors do not match."""
    pin, lug = ring([0.4, 1.0], 16, 2), ring([1.0, 2.0], 16, 3)
    for meshes in ({"pin": pin, "lug": lug}, {"lug": lug, "pin": pin}):
        mesh = bodies(meshes)
        assert_matched(mesh)
        assert measure_part(mesh, "|".join(meshes)) == pytest.approx(32 * np.sin(np.pi / 16), abs=1e-9)
    for other in (ring([1.0, 2.0], 24, 3), rotate(lug, np.pi / 16, (0.0, 0.0))):
        for tolerance in (None, 1e-3, 0.03):
            with pytest.raises(vx.MeshError, match="[Gg]ive both bodies the same nodes|give a smaller tolerance="):
                bodies({"pin": pin, "lug": other}, tolerance=tolerance)


def test_invalid_sets_of_bodies_are_refused():
    a = cubes(1)
    beside = rotate(cubes(1, ((1.2, 2.2), (0, 1), (0.2, 0.8))), np.pi / 4, (1.2, 0.5))
    tubes = {"a": ring([0.9, 1.0], 32, 1), "b": ring([1.0, 1.1], 24, 1)}
    for meshes, options, subject in (
        ({"a": a, "b": cubes(1)}, {}, r"'a' and 'b' overlap near \("),
        ({"a": a, "b": cubes(2, ((0.5, 1.5), (0, 1), (0, 1)))}, {}, r"'a' and 'b' overlap near"),
        ({"a": a, "b": cubes(2, ((0.2, 0.8), (0.2, 0.8), (0.2, 0.8)))}, {}, "'a' and 'b' overlap near"),
        (tubes, {}, "'a' and 'b' overlap near .* give both bodies the same nodes there"),
        ({"a": a, "b": cubes(1, ((1, 2), (1, 2), (0, 1)))}, {}, r"near \(1, 1, 0\), or touch there only in"),
        ({"a": a, "b": cubes(1, ((1, 2), (1, 2), (1, 2)))}, {}, r"near \(1, 1, 1\), or touch there only in"),
        ({"a": a, "b": beside}, {}, "'a' and 'b' overlap near"),
        ({"a": a, "b": cubes(1, ((1 + 1e-7, 2), (0, 1), (0, 1)))}, {}, "less than 0.001 of the smallest cell height"),
        ({"a": a, "b": cubes(1, ((1, 1.2), (0, 1), (0, 1)))}, {"tolerance": 0.3}, r"near \(.* move to the same place"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            bodies(meshes, **options)
    with pytest.raises(vx.MeshError, match=r"a face at \(0\.5, 0\.375, 0\.375\) has crack tips at all its nodes"):
        cubes(4).cut("crack", {"a": [21], "b": [22]})


def make_slab(heights, is_lower, middle):
    """Return 3 x 3 cells with a surface of triangles. `middle` selects the diagonal of the middle cell."""
    x, y = np.meshgrid(range(4), range(4))
    z = np.append(heights, np.full(16, -1.0 if is_lower else 3.0))
    points = np.column_stack([np.tile([x.ravel(), y.ravel()], 2).T, z])
    cells = []
    for k, corner in enumerate(i + 4 * j for j in range(3) for i in range(3)):
        near = corner + np.array([0, 1, 5, 4])
        turned = np.roll(near, middle if k == 4 else 0)
        faces = [turned[[0, 1, 2]], turned[[0, 2, 3]], near[::-1] + 16]
        faces += [np.array([near[e - 1], near[e - 1] + 16, near[e] + 16, near[e]]) for e in range(4)]
        cells.append([face if is_lower else face[::-1] for face in faces])
    return vx.PolyhedralMesh(points, cells)


def test_a_pocket_between_bodies_is_refused():
    """Two surfaces of triangles have equal nodes, and different diagonals of the middle cell."""
    heights = np.ones(16)
    heights[[5, 10]] = 0.8
    lower = make_slab(heights, True, 0)
    assert len(bodies({"a": lower, "b": make_slab(heights, False, 0)}).boundaries["a|b"]) == 18
    with pytest.raises(vx.MeshError, match=r"surfaces of two bodies do not match near \(1\.\d+, 1\.\d+, 0\.\d+\)"):
        bodies({"a": lower, "b": make_slab(heights, False, 1)})


def test_invalid_interfaces_are_refused():
    mesh = bodies({"a": cubes(1), "b": cubes(1, NEXT_DOOR)})
    found = mesh.interfaces["a|b"]
    extra = [[0, 1, 2, -1]]
    for edges, partners, subject in (
        (found.edges[:, [0, 2, 1]], found.partners[:, [0, 2, 1]], "same place"),
        (
            np.append(found.edges, extra, axis=0),
            np.append(found.partners, extra, axis=0),
            r"\(0, 1, 2\) is not on the boundary",
        ),
        (found.edges, found.partners[:, [2, 1, 0, 3]], "nodes 1 and 14 are partners .* but lie at"),
        (found.edges + 100, found.partners, r"edges and partners must be nodes 0 to 15 in arrays of one shape"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            vx.PolyhedralMesh(
                mesh.points, mesh.cells, interfaces={"a|b": replace(found, edges=edges, partners=partners)}
            )
    with pytest.raises(vx.MeshError, match=r"in the same place, .* join them with vx\.meshes\.bodies"):
        vx.PolyhedralMesh(mesh.points, mesh.cells)
