"""Conversion of meshes from and to other libraries, and sides that are named by position."""

from __future__ import annotations

import sys
import warnings

import meshio
import numpy as np
import pytest
import skfem
from same_mesh import assert_same, label
from scenes import rotation

import vemcvx as vx
from vemcvx.meshes import FAMILIES, convert, read

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
BOX = ((0.1, 1.1), (2.0, 4.0), (-5.0, -4.0))
CUBE = [(x, y, z) for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)]
HEXAHEDRON = [[0, 1, 3, 2, 4, 5, 7, 6]]


def import_pyvista():
    return pytest.importorskip("pyvista", reason="PyVista, the extra view, is not installed")


def make(family):
    return label(FAMILIES[family](4, ((-1.0 / 3.0, 1.0), (0.1, 0.7)), seed=2))


@pytest.mark.parametrize("family", FAMILIES)
def test_conversion_to_meshio_and_pyvista_and_back_restores_polygons(family):
    mesh = make(family)
    assert_same(mesh, convert(mesh.to("meshio")))
    import_pyvista()
    grid = mesh.to("pyvista")
    np.testing.assert_array_equal(grid.cell_data["material"], mesh.cell_data["material"])
    assert (grid.n_cells, grid.n_points) == (mesh.n_cells, mesh.n_nodes)
    if family != "nonconvex":  # VTK needs convex cells for areas
        np.testing.assert_allclose(grid.compute_cell_sizes().cell_data["Area"], mesh.areas, rtol=1e-12)
    assert_same(mesh, convert(grid))


def test_sets_of_meshio_become_boundaries_and_cell_data():
    cells = [("quad", [[0, 1, 2, 3]]), ("line", [[0, 1], [1, 2]])]
    sets = {"floor": [np.array([], int), np.array([0])], "steel": [np.array([0]), np.array([], int)]}
    mesh = convert(meshio.Mesh(SQUARE, cells, cell_sets=sets))
    assert mesh.boundaries["floor"].tolist() == [[0, 1]]
    assert mesh.cell_data["steel"].tolist() == [1]
    assert set(mesh.boundaries) == {"floor", "boundary"}
    quad = ("quad", np.array([[0, 1, 3, 2]]) + 1)
    cube = meshio.Mesh(
        [(9, 9, 9), *CUBE], [("hexahedron", np.array(HEXAHEDRON) + 1), quad], cell_sets={"floor": [[], [0]]}
    )
    with pytest.warns(vx.MeshWarning, match="1 of 9 nodes belong to no cell"):
        back = convert(cube)
    assert (back.face_normals[back.boundaries["floor"]] == (0, 0, -1)).all()


def make_skfem_mesh(kind):
    """Return an irregular mesh of scikit-fem with three boundaries and two subdomains."""
    flat = kind.init_tensor(np.linspace(0, 2, 5) ** 1.2, np.linspace(0, 1, 4))
    x, y = flat.p
    inner = (x > 0) & (x < x.max()) & (y > 0) & (y < 1)
    moved = flat.p + 0.05 * inner * np.array([np.sin(7 * y), np.cos(5 * x)])
    flat = kind(moved, flat.t)
    sides = {
        "held": lambda x: x[0] > x[0].max() - 1e-9,
        "pushed": lambda x: x[0] < 1e-9,
        "floor": lambda x: x[1] < 1e-9,
    }
    return flat.with_boundaries(sides).with_subdomains({"soft": lambda x: x[0] < 1.0, "none": lambda x: x[0] < 0.0})


@pytest.mark.parametrize("kind", [skfem.MeshTri, skfem.MeshQuad])
def test_conversion_from_scikit_fem_and_back_restores_the_mesh(kind):
    flat = make_skfem_mesh(kind)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # clockwise cells are usual in scikit-fem
        mesh = convert(flat)
    assert set(mesh.boundaries) == {"held", "pushed", "floor", "boundary"}
    back = mesh.to("skfem")
    assert type(back) is type(flat)
    np.testing.assert_array_equal(back.p, flat.p)
    np.testing.assert_array_equal(np.sort(back.t, axis=0), np.sort(flat.t, axis=0))
    assert back.is_valid()
    for name in flat.boundaries:
        np.testing.assert_array_equal(np.sort(back.boundaries[name]), np.sort(flat.boundaries[name]))
    for name in flat.subdomains:
        np.testing.assert_array_equal(back.subdomains[name], flat.subdomains[name])
    assert_same(mesh, convert(back))


def test_scikit_fem_keeps_names_of_boundaries_and_sets_of_cells_only():
    made = make("squares").to("skfem")
    assert set(made.boundaries) == set(make("squares").boundaries) - {"boundary"}
    assert not made.subdomains


def test_polydata_of_pyvista_becomes_polygons():
    pv = import_pyvista()
    mesh = vx.meshes.hexagons(3)
    cells = np.insert(mesh.vertices, mesh.offsets[:-1], np.diff(mesh.offsets))
    data = pv.PolyData(np.pad(mesh.points, ((0, 0), (0, 1))), cells)
    data.cell_data["young"] = np.arange(mesh.n_cells)
    assert_same(mesh.with_cell_data("young", np.arange(mesh.n_cells)), convert(data))


def test_invalid_objects_of_other_libraries_are_refused(monkeypatch):
    quads = [("quad", [[0, 1, 2, 3]])]
    uneven = meshio.Mesh([*SQUARE, (2, 0), (2, 1)], [("triangle", [(0, 1, 2), (0, 2, 3)]), ("quad", [(1, 4, 5, 2)])])
    uneven.cell_data["a"] = [np.zeros(1), np.zeros(1)]
    for other, subject in (
        (skfem.MeshTri2(), "scikit-fem: it has cells of the kind 'ElementTriP2'"),
        (skfem.MeshTri(np.full((2, 3), np.nan), np.array([[0], [1], [2]])), "node 0 is at .nan, nan."),
        (meshio.Mesh(SQUARE, []), "meshio: it has no polygons"),
        (meshio.Mesh(SQUARE, [("quad", [[0, 1, 2, 7]])]), "meshio: cell 0 names node 7"),
        (meshio.Mesh(SQUARE, quads, field_data={"boundary:a": np.array([1.5, 2.0])}), "'boundary:a' is not an array"),
        (uneven, r"meshio: its cell datum 'a' has the shape \(2,\) on 3 cells"),
    ):
        with pytest.raises(vx.MeshError, match=f"the mesh of .*{subject}"):
            convert(other)
    for library, package in (("pyvista", r"vemcvx\[view\]"), ("skfem", "scikit-fem")):
        monkeypatch.setitem(sys.modules, library, None)
        with pytest.raises(vx.VemcvxError, match=f"which is not installed: pip install '?{package}"):
            vx.meshes.squares(1).to(library)


def test_invalid_objects_of_pyvista_are_refused():
    pv = import_pyvista()
    for other, subject in (
        (pv.PolyData(), "the mesh of PyVista: it has no cells"),
        (pv.Sphere(), "its points do not lie in a plane z = constant"),
        (pv.ImageData(dimensions=(3, 3, 1)), "cells of the kind 'pixel'"),
        (pv.MultiBlock(), "convert takes .* got MultiBlock"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            convert(other)


# Meshes in space.


def make_four_cells():
    """Return a hexahedron under a pyramid, and a wedge under a tetrahedron."""
    points = [*CUBE, (0.5, 0.5, 2.0), (2.0, 0.5, 0.0), (2.0, 0.5, 1.0), (1.5, 0.5, 2.0)]
    blocks = [
        ("wedge", [[1, 9, 3, 5, 10, 7]]),
        ("hexahedron", HEXAHEDRON),
        ("tetra", [[5, 10, 7, 11]]),
        ("pyramid", [[4, 5, 7, 6, 8]]),
    ]
    return meshio.Mesh(
        points, blocks, cell_data={"young": [[3.0], [1.0], [4.0], [2.0]]}, cell_sets={"soft": [[0], [], [0], None]}
    )


def make_solid(name):
    """Return a mesh in space with one or four kinds of cells."""
    if name == "mixed":
        return convert(make_four_cells())
    if name == "wedges":
        return vx.meshes.triangles(2).extruded([0.0, 0.5, 1.0])
    mesh = vx.meshes.SPACE_FAMILIES[name](2, BOX)
    return mesh.with_cell_data("soil", (np.arange(mesh.n_cells) % 2).astype(np.uint8))


def assert_equal_but_for_faces(one, other):
    """Check that two meshes are equal except for face numbers."""
    np.testing.assert_array_equal(one.points, other.points)
    for nodes, others in zip(one.cell_nodes, other.cell_nodes, strict=True):
        np.testing.assert_array_equal(nodes, others)
    np.testing.assert_allclose(one.volumes, other.volumes, rtol=1e-13)
    assert set(one.cell_data) == set(other.cell_data)
    assert set(one.boundaries) == set(other.boundaries)
    for name in one.boundaries:
        middles = [sorted(m.face_centroids[m.boundaries[name]].round(12).tolist()) for m in (one, other)]
        assert middles[0] == middles[1]


@pytest.mark.parametrize("name", ["cubes", "tetrahedra", "wedges", "mixed"])
def test_conversion_to_meshio_and_back_restores_solids(name):
    mesh = make_solid(name)
    assert_equal_but_for_faces(mesh, convert(mesh.to("meshio")))


def test_cells_of_meshio_may_be_numbered_in_either_direction():
    """Mirror cells of four kinds, so that the order of nodes is reversed."""
    with pytest.warns(vx.MeshWarning, match="sides are named left, front, back, bottom"):
        mesh = convert(make_four_cells())
    np.testing.assert_allclose(mesh.volumes, [0.5, 1.0, 1 / 6, 1 / 3])
    assert mesh.cell_data["young"].tolist() == [3, 1, 4, 2]
    assert mesh.cell_data["soft"].tolist() == [1, 0, 1, 0]
    mirrored = make_four_cells()
    mirrored.points = mirrored.points * [-1.0, 1.0, 1.0]
    with pytest.warns(vx.MeshWarning) as caught:
        np.testing.assert_allclose(convert(mirrored).volumes, mesh.volumes)
    assert all("by position" in str(one.message) for one in caught)


@pytest.mark.parametrize(("name", "kind"), [("cubes", "MeshHex1"), ("tetrahedra", "MeshTet1")])
def test_conversion_to_scikit_fem_and_back_restores_solids(name, kind):
    """The volume in scikit-fem depends on the order of vertices."""
    mesh = make_solid(name)
    made = mesh.to("skfem")
    assert type(made).__name__ == kind
    assert_equal_but_for_faces(mesh, convert(made))
    basis = skfem.Basis(made, skfem.ElementHex1() if name == "cubes" else skfem.ElementTetP1())
    assert (basis.dx > 0.0).all()
    assert basis.dx.sum() == pytest.approx(2.0, rel=1e-13)


@pytest.mark.parametrize("family", vx.meshes.SPACE_FAMILIES)
def test_conversion_to_pyvista_and_its_files_restore_polyhedra(family, tmp_path):
    """Read a compressed file and a text file of PyVista. PyVista computes volumes from a file that `write` wrote."""
    pv = import_pyvista()
    mesh = vx.meshes.SPACE_FAMILIES[family](2, BOX, 1)
    mesh = mesh.with_cell_data("young", np.arange(mesh.n_cells)).with_boundary("half", lambda x: x[:, 1] < 3.0)
    grid = mesh.to("pyvista")
    assert_equal_but_for_faces(mesh, convert(grid))
    for binary in (True, False):
        grid.save(tmp_path / "grid.vtu", binary=binary)
        assert_equal_but_for_faces(mesh, read(tmp_path / "grid.vtu"))
    mesh.write(tmp_path / "package.vtu")
    back = pv.read(tmp_path / "package.vtu")
    solid = back.celltypes == 42
    np.testing.assert_allclose(back.compute_cell_sizes()["Volume"][solid], mesh.volumes, rtol=1e-12)
    assert back.cell_data["boundary:half"].sum() == len(mesh.boundaries["half"])


# Sides named by position.


def remove_names(mesh):
    return vx.PolygonMesh(mesh.points, list(mesh.cells), boundaries={})


NAMED = "no part of the boundary has a name; by position, sides are named "


@pytest.mark.parametrize("family", ["squares", "voronoi", "hanging"])
def test_sides_of_a_box_in_a_file_without_names_are_named_by_position(family, tmp_path):
    """Test exact points, and points that were rotated and rotated back."""
    mesh = FAMILIES[family](4, ((-3.0, 1.0), (0.1, 2.7)))
    back = mesh.points @ rotation(0.3) @ rotation(-0.3)
    assert np.abs(back - mesh.points).max() > 0
    for points in (mesh.points, back):
        remove_names(vx.PolygonMesh(points, list(mesh.cells))).write(tmp_path / "part.vtu")
        with pytest.warns(vx.MeshWarning, match=f"part.vtu: {NAMED}left, right, bottom, top.$") as caught:
            found = read(tmp_path / "part.vtu")
        assert caught[0].filename == __file__
        assert set(found.boundaries) == set(mesh.boundaries)
        for name, edges in mesh.boundaries.items():
            np.testing.assert_array_equal(found.boundaries[name], edges)


def test_only_straight_sides_at_extreme_coordinates_are_named():
    """Test a pentagon with a peak, a diamond, and a very short edge."""
    house = meshio.Mesh([*SQUARE.tolist(), (0.5, 1.5)], [("polygon", [[0, 1, 2, 4, 3]])])
    with pytest.warns(vx.MeshWarning, match=f"{NAMED}left, right, bottom.$"):
        assert set(convert(house).boundaries) == {"left", "right", "bottom", "boundary"}
    diamond = meshio.Mesh([(0, -1), (1, 0), (0, 1), (-1, 0)], [("quad", [[0, 1, 2, 3]])])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert set(convert(diamond).boundaries) == {"boundary"}
    corner = meshio.Mesh([*SQUARE.tolist(), (0, 1e-11)], [("polygon", [[0, 1, 2, 3, 4]])])
    found = convert(corner).boundaries
    assert found["bottom"].tolist() == [[0, 1]]
    assert sorted(found["left"].tolist()) == [[3, 4], [4, 0]]
