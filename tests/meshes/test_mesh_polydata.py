"""VTK's files of polygons alone, .vtp and .vtk."""

from __future__ import annotations

import locale

import numpy as np
import polydata
import pytest

import vemcvx as vx
from vemcvx.meshes import FAMILIES, read

KINDS = {
    "4.2.vtk": lambda mesh: polydata.legacy(mesh, "4.2"),
    "4.2 in words.vtk": lambda mesh: polydata.legacy(mesh, "4.2", binary=False),
    "5.1.vtk": lambda mesh: polydata.legacy(mesh, "5.1"),
    "5.1 in words.vtk": lambda mesh: polydata.legacy(mesh, "5.1", binary=False),
    "in words.vtp": polydata.xml,
    "appended.vtp": lambda mesh: polydata.xml(mesh, appended=True),
}


@pytest.fixture(autouse=True)
def locale_of_the_process():
    """VTK's legacy files leave it at "C", in which Python reads no text but ASCII."""
    before = locale.setlocale(locale.LC_ALL)
    yield
    locale.setlocale(locale.LC_ALL, before)


@pytest.mark.parametrize("family", ["voronoi", "hanging"])
@pytest.mark.parametrize("kind", KINDS)
def test_they_are_read_to_the_bit(kind, family, tmp_path):
    mesh = FAMILIES[family](3)
    (tmp_path / kind).write_bytes(KINDS[kind](mesh))
    found = read(tmp_path / kind)
    np.testing.assert_array_equal(found.points, mesh.points)
    np.testing.assert_array_equal(found.offsets, mesh.offsets)
    np.testing.assert_array_equal(found.vertices, mesh.vertices)
    assert set(found.boundaries) == set(mesh.boundaries)
    young, kinds = polydata.data(mesh)
    np.testing.assert_array_equal(found.cell_data["young's modulus"], young)
    np.testing.assert_array_equal(found.cell_data["kind"], kinds)


@pytest.mark.long
def test_vtk_reads_the_files_of_this_test_so_too(tmp_path):
    pyvista = pytest.importorskip("pyvista", reason="PyVista, the extra view, is not installed")
    mesh = vx.meshes.voronoi(3)
    for kind, made in KINDS.items():
        (tmp_path / kind).write_bytes(made(mesh))
        found = pyvista.read(tmp_path / kind)
        np.testing.assert_array_equal(found.points[:, :2], mesh.points)
        np.testing.assert_array_equal(vx.meshes.convert(found).vertices, mesh.vertices)
        np.testing.assert_array_equal(found.cell_data["kind"], polydata.data(mesh)[1])


def test_files_of_vtk_itself(tmp_path):
    """As PyVista saves grids of ours, whole numbers and field data included."""
    pyvista = pytest.importorskip("pyvista", reason="PyVista, the extra view, is not installed")
    mesh = vx.meshes.hexagons(3).with_boundary("half", lambda x: x[:, 0] < 0.4)
    mesh = mesh.with_cell_data("material", np.arange(mesh.n_cells)).with_cell_data("load", np.ones((mesh.n_cells, 3)))
    grid = mesh.to("pyvista")
    flat = pyvista.PolyData(grid.points, grid.cells)
    flat.cell_data.update(grid.cell_data)
    flat.field_data.update(grid.field_data)
    for saved, name, binary in (
        (grid, "grid.vtu", True),
        (grid, "grid.vtk", True),
        (grid, "words.vtk", False),
        (flat, "flat.vtp", True),
        (flat, "flat.vtk", True),
    ):
        saved.save(tmp_path / name, binary=binary)
        found = read(tmp_path / name)
        np.testing.assert_array_equal(found.vertices, mesh.vertices)
        np.testing.assert_array_equal(found.cell_data["material"], mesh.cell_data["material"])
        np.testing.assert_array_equal(found.cell_data["load"], mesh.cell_data["load"])
        names = set(mesh.boundaries)
        assert set(found.boundaries) == names
        assert all(found.boundaries[side].tolist() == mesh.boundaries[side].tolist() for side in names)


WORDS = polydata.legacy(vx.meshes.squares(2), "4.2", binary=False)
XML = polydata.xml(vx.meshes.squares(2))


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("lines.vtk", WORDS.replace(b"POLYGONS", b"LINES 1 3\n2 0 1\nPOLYGONS"), "it holds lines beside polygons"),
        ("strips.vtk", WORDS.replace(b"POLYGONS", b"TRIANGLE_STRIPS"), "it holds no polygons"),
        ("many.vtk", WORDS.replace(b"POLYGONS 4", b"POLYGONS 999999999999"), "its lists of cells are damaged"),
        ("none.vtk", WORDS.replace(b"POLYGONS 4", b"POLYGONS 0"), "it holds no polygons"),
        ("lines.vtp", XML.replace(b'Lines="0"', b'Lines="2"'), "it holds lines beside polygons"),
        ("many.vtp", XML.replace(b'Polys="4"', b'Polys="99999999"'), "it claims 99999999 cells; there are 4"),
        ("none.vtp", XML.replace(b"NumberOfPolys", b"NumberOfPores"), "it holds no polygons"),
        ("pieces.vtp", XML.replace(b"<Piece ", b"<Piece/><Piece "), "it holds 2 pieces; wanted is one"),
        ("other.vtp", b"<VTKFile/>", "it holds no polygons"),
        ("short.vtp", XML[:-400], "short.vtp cannot be read as a mesh"),
    ],
)
def test_what_is_refused(name, data, message, tmp_path, capfd):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(vx.MeshError, match=message):
        read(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_they_are_not_written(tmp_path):
    with pytest.raises(vx.MeshError, match=".vtp files are read, not written; .vtu and .vtk hold every mesh"):
        vx.meshes.voronoi(2).write(tmp_path / "mesh.vtp")
