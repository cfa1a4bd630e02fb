"""VTU files that the package writes."""

from __future__ import annotations

import pickle
from functools import cache
from xml.etree import ElementTree

import numpy as np
import pytest
from refined_cubes import refined_cubes
from same_mesh import assert_same, label

import vemcvx as vx
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES, read

BOX = ((0.1, 1.1), (2.0, 4.0), (-5.0, -4.0))


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
    mesh.with_cell_data("soft", np.arange(mesh.n_cells) % 2 == 0).write(tmp_path / "mesh.vtu")
    np.testing.assert_array_equal(read(tmp_path / "mesh.vtu").cell_data["soft"], np.arange(mesh.n_cells) % 2 == 0)


def test_missing_folders_and_folders_in_place_of_files_are_refused(tmp_path):
    (tmp_path / "folder.vtu").mkdir()
    for path in (tmp_path / "no" / "mesh.vtu", tmp_path / "folder.vtu", "x" * 300 + ".vtu"):
        with pytest.raises(vx.MeshError, match=r"vtu cannot be written \("):
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
    with pytest.raises(vx.MeshError, match=r"mesh.vtu cannot be written \(OSError: No space left on device\)"):
        vx.meshes.squares(3).write(tmp_path / "mesh.vtu")
    assert (tmp_path / "mesh.vtu").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["mesh.vtu"]
