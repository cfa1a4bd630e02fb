"""Mesh files that the package writes: VTU files restore meshes exactly; for other formats, losses are named."""

from __future__ import annotations

import pickle
from functools import cache
from xml.etree import ElementTree

import numpy as np
import pytest
from refined_cubes import refined_cubes
from same_mesh import assert_same, label

import vemcvx as vx
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES, PolygonMesh, read

BOX = ((0.1, 1.1), (2.0, 4.0), (-5.0, -4.0))
SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


@cache
def make(name):
    """Return a mesh with overlapping boundaries, unusual names, and cell data of several types."""
    if name in FAMILIES:
        mesh = FAMILIES[name](4, ((-1.0 / 3.0, 1.0), (0.1, 0.7)), seed=2)
    elif name == "refined":
        mesh = refined_cubes(2, (0, 3), 0.3)
    elif name == "dented":
        mesh = vx.meshes.nonconvex(3, seed=1).extruded([0.0, 0.3, 1.0])
    else:
        mesh = SPACE_FAMILIES[name](2, BOX, 1)
    return label(mesh)


@pytest.fixture(params=[*FAMILIES, *SPACE_FAMILIES, "refined", "dented"])
def mesh(request):
    return make(request.param)


def test_vtu_files_and_pickles_restore_meshes_exactly(mesh, tmp_path, capfd):
    mesh.write(tmp_path / "mesh.VTU")
    assert_same(mesh, read(str(tmp_path / "mesh.VTU")))
    assert [path.name for path in tmp_path.iterdir()] == ["mesh.VTU"]
    assert capfd.readouterr() == ("", "")
    back = pickle.loads(pickle.dumps(mesh))
    assert_same(mesh, back)
    assert not back.cell_data["material"].flags.writeable
    assert repr(back) == repr(mesh)
    assert "material" in mesh._repr_html_()
    mesh.with_cell_data("soft", np.arange(mesh.n_cells) % 2 == 0).write(tmp_path / "mesh.vtu")
    np.testing.assert_array_equal(read(tmp_path / "mesh.vtu").cell_data["soft"], np.arange(mesh.n_cells) % 2 == 0)


def split_cube():
    """Return a cube of six pyramids with a common apex."""
    points = [*[(x, y, z) for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)], (0.5, 0.4, 0.6)]
    faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    return vx.PolyhedralMesh(points, [[face, *([face[k], face[k - 1], 8] for k in range(4))] for face in faces])


def make_standard(name):
    """Return a mesh of cells of standard kinds, which other programs also have."""
    if name == "pyramids":
        return split_cube()
    if name == "wedges":
        return vx.meshes.triangles(2).extruded([0.0, 0.5, 1.0])
    if name == "mixed":
        points = [*SQUARE, (2.0, 0.0), (2.0, 1.0)]
        return PolygonMesh(points, [[1, 4, 5], [0, 1, 2, 3], [1, 5, 2]])
    return (SPACE_FAMILIES | FAMILIES)[name](2)


@pytest.mark.parametrize("name", ["squares", "mixed", "cubes", "tetrahedra", "wedges", "pyramids"])
def test_files_of_gmsh_keep_boundaries_and_sets_and_order_of_cells(name, tmp_path):
    soft = np.arange(make_standard(name).n_cells) % 2
    mesh = make_standard(name).with_boundary("lid", lambda x: x[:, -1] == x[:, -1].max()).with_cell_data("soft", soft)
    mesh.write(tmp_path / "mesh.msh")
    back = read(tmp_path / "mesh.msh")
    for one, other in zip(mesh.cell_nodes, back.cell_nodes, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_allclose(back.measures, mesh.measures, rtol=1e-8)
    np.testing.assert_array_equal(back.points, mesh.points)
    assert back.cell_data["soft"].tolist() == soft.tolist()
    assert set(back.boundaries) == set(mesh.boundaries)
    for side, parts in mesh.boundaries.items():
        middles = [one._middles[one._places(p)] for one, p in ((mesh, parts), (back, back.boundaries[side]))]
        np.testing.assert_array_equal(*(np.sort(rows.round(12), axis=0) for rows in middles))


def test_a_warning_names_the_data_that_files_of_gmsh_lose(tmp_path):
    mesh = vx.meshes.triangles(3).with_cell_data("young", np.arange(18.0)).with_cell_data("soft", np.arange(18) < 9)
    with pytest.warns(vx.MeshWarning, match=r"mesh.msh: .msh files do not keep 'young'; .vtu files do") as caught:
        mesh.write(tmp_path / "mesh.msh")
    assert caught[0].filename == __file__


def test_missing_folders_and_folders_in_place_of_files_are_refused(tmp_path):
    (tmp_path / "folder.vtu").mkdir()
    for path in (tmp_path / "no" / "mesh.vtu", tmp_path / "folder.vtu", "x" * 300 + ".vtu"):
        with pytest.raises(vx.MeshError, match=r"vtu cannot be written; .vtu holds every mesh \("):
            vx.meshes.squares(2).write(path)
    for path, subject in ((tmp_path / "folder.vtu", "folder.vtu: there is no such file"), ("x" * 300 + ".vtu", "vtu")):
        with pytest.raises(vx.MeshError, match=subject):
            read(path)


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    vx.meshes.squares(2).write(tmp_path / "mesh.vtu")
    before = (tmp_path / "mesh.vtu").read_bytes()

    def fail(*_, **__):
        raise OSError("No space left on device")

    monkeypatch.setattr(ElementTree, "tostring", fail)
    with pytest.raises(vx.MeshError, match=r"mesh.vtu cannot be written; .* \(OSError: No space left on device\)"):
        vx.meshes.squares(3).write(tmp_path / "mesh.vtu")
    assert (tmp_path / "mesh.vtu").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["mesh.vtu"]
