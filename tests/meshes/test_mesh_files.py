"""Mesh files: what comes back to the bit, what is refused, what damaged files say."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest

import vemcvx as vx
from vemcvx.meshes import FAMILIES, PolygonMesh, read
from vemcvx.meshes.io.vtk import packed_cells, write_cells

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def assert_same(one, other):
    np.testing.assert_array_equal(other.points, one.points)
    np.testing.assert_array_equal(other.offsets, one.offsets)
    np.testing.assert_array_equal(other.vertices, one.vertices)
    assert set(other.boundaries) == set(one.boundaries)
    for name, edges in one.boundaries.items():
        np.testing.assert_array_equal(other.boundaries[name], edges)
    assert set(other.cell_data) == set(one.cell_data)
    for name, values in one.cell_data.items():
        np.testing.assert_array_equal(other.cell_data[name], values)


def rich(family, n=4):
    """A mesh with overlapping names, names that are hard to spell, and data of all kinds."""
    random = np.random.default_rng(1)
    mesh = FAMILIES[family](n, ((-1.0 / 3.0, 1.0), (0.1, 0.7)), seed=2)
    return (
        mesh.with_boundary('größe <& "x"> of all', lambda x: x[:, 0] < 0.5)
        .with_cell_data("young's modulus / Pa", random.random(mesh.n_cells))
        .with_cell_data("material", np.arange(mesh.n_cells) % 3)
        .with_cell_data("single", random.random(mesh.n_cells).astype(np.float32))
        .with_cell_data("vector", random.random((mesh.n_cells, 3)))
    )


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".VTU"])
@pytest.mark.parametrize("family", FAMILIES)
def test_round_trip_of_every_mesh(family, suffix, tmp_path, capfd):
    mesh = rich(family)
    mesh.write(tmp_path / f"mesh{suffix}")
    again = read(str(tmp_path / f"mesh{suffix}"))
    assert_same(mesh, again)
    assert {name: values.dtype for name, values in again.cell_data.items()} == {
        name: values.dtype for name, values in mesh.cell_data.items()
    }
    assert [path.name for path in tmp_path.iterdir()] == [f"mesh{suffix}"]
    assert capfd.readouterr() == ("", "")


def test_truth_values_come_back_as_numbers(tmp_path):
    mesh = vx.meshes.squares(2).with_cell_data("soft", np.array([True, False, True, True]))
    mesh.write(tmp_path / "mesh.vtu")
    assert read(tmp_path / "mesh.vtu").cell_data["soft"].tolist() == [1, 0, 1, 1]


@pytest.mark.parametrize("family", ["squares", "triangles", "distorted"])
def test_gmsh_round_trip(family, tmp_path, capfd):
    mesh = FAMILIES[family](3).with_boundary("lower half", lambda x: x[:, 1] < 0.5)
    mesh.write(tmp_path / "mesh.msh")
    assert_same(mesh, read(tmp_path / "mesh.msh"))
    assert capfd.readouterr() == ("", "")


def test_gmsh_keeps_the_order_of_mixed_cells(tmp_path):
    points = [*SQUARE, (2.0, 0.0), (2.0, 1.0)]
    mesh = PolygonMesh(points, [[1, 4, 5], [0, 1, 2, 3], [1, 5, 2]], boundaries={"floor": [(0, 1), (1, 4)]})
    mesh.write(tmp_path / "mesh.msh")
    assert_same(mesh, read(tmp_path / "mesh.msh"))


@pytest.mark.parametrize("suffix", [".inp", ".bdf", ".nas", ".fem"])
def test_other_formats_say_what_they_lose(suffix, tmp_path):
    mesh = vx.meshes.triangles(3).with_cell_data("young", np.ones(18))
    with pytest.warns(vx.MeshWarning, match=r"files do not keep .*'bottom', 'left', 'right', 'top', 'young'; .vtu and"):
        mesh.write(tmp_path / f"mesh{suffix}")
    again = read(tmp_path / f"mesh{suffix}")
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    np.testing.assert_allclose(again.points, mesh.points, atol=1e-5)


def test_rounded_points_are_said(tmp_path):
    with pytest.warns(vx.MeshWarning, match="do not keep all digits of the points") as caught:
        vx.meshes.triangles(3).write(tmp_path / "mesh.bdf")
    assert caught[0].filename == __file__


@pytest.mark.filterwarnings("ignore:.*do not keep all digits:vemcvx.MeshWarning")
@pytest.mark.parametrize("size", [1e-12, 1e-5, 1.0, 1e5, 1e12])
def test_points_that_nastran_has_no_room_for_are_rounded(size, tmp_path):
    """Where they were negative, or had exponents of two digits, the file was not written at all."""
    low, high = np.array([[-np.pi, -1.0], [np.e, 1.0 / 3.0]]) * size
    mesh = vx.meshes.squares(4, box=tuple(zip(low, high, strict=True)))
    mesh.write(tmp_path / "mesh.bdf")
    again = read(tmp_path / "mesh.bdf").points
    assert np.abs(again - mesh.points).max() <= 5e-10 * np.abs(mesh.points).max()  # Ten digits at least are left.


@pytest.mark.parametrize("suffix", [".msh", ".inp", ".bdf"])
@pytest.mark.parametrize("family", ["voronoi", "hexagons", "hanging", "nonconvex"])
def test_formats_that_lose_polygons_are_refused(family, suffix, tmp_path):
    with pytest.raises(vx.MeshError, match=r"do not keep polygons of more than four vertices.*Write .vtu or .vtk"):
        FAMILIES[family](3).write(tmp_path / f"mesh{suffix}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".hmf", ".med", ".xdmf", ".stl", ".off", ".ele", ".vol.gz", ".doc", ""])
def test_other_formats_are_refused(suffix, tmp_path):
    """The list is closed: behind some of these are readers that hang on damaged files."""
    (tmp_path / f"mesh{suffix}").touch()
    says = (
        f"mesh{suffix}: the suffix {Path(f'mesh{suffix}').suffix!r} is none of the mesh formats here: "
        "Gmsh (.msh), VTK (.vtu, .vtk, .vtp), Abaqus (.inp) and Nastran (.bdf, .nas, .fem). Convert the file: "
        f"meshio convert mesh{suffix} mesh"
    )
    for attempt in (read, vx.meshes.squares(2).write):
        with pytest.raises(vx.MeshError, match=re.escape(says) + r".*\.vtu$"):
            attempt(tmp_path / f"mesh{suffix}")


@pytest.mark.parametrize("name", ['a "b', "a\\b", "a\nb"])
def test_names_that_gmsh_cannot_have(name, tmp_path):
    """A quote or a backslash in a name made a file that nobody reads."""
    mesh = vx.meshes.squares(2).with_boundary(name, lambda x: x[:, 0] < 0.1)
    with pytest.raises(vx.MeshError, match="mesh.msh: .msh files have no names with quotes, backslashes or ends of"):
        mesh.write(tmp_path / "mesh.msh")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("no/mesh.vtu", "there is no folder .*no; create it first"),
        ("folder.vtu", "folder.vtu is a folder; name a file"),
    ],
)
def test_places_that_cannot_be_written(path, message, tmp_path):
    (tmp_path / "folder.vtu").mkdir()
    with pytest.raises(vx.MeshError, match=message):
        vx.meshes.squares(2).write(tmp_path / path)


def test_paths_must_be_paths():
    with pytest.raises(vx.MeshError, match="must be a string or Path; got 3"):
        read(3)


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    vx.meshes.squares(2).write(tmp_path / "mesh.vtu")
    before = (tmp_path / "mesh.vtu").read_bytes()

    def full(*_, **__):
        raise OSError("No space left on device")

    monkeypatch.setattr(ElementTree.ElementTree, "write", full)
    with pytest.raises(vx.MeshError, match=r"mesh.vtu cannot be written \(OSError: No space left on device\)"):
        vx.meshes.squares(3).write(tmp_path / "mesh.vtu")
    assert (tmp_path / "mesh.vtu").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["mesh.vtu"]


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.vtu", None, "missing.vtu: there is no such file"),
        ("empty.vtu", b"", "empty.vtu cannot be read as a mesh"),
        ("foreign.vtu", b"\x89PNG\r\n\x1a\n" + bytes(100), "foreign.vtu cannot be read as a mesh"),
        ("text.vtk", b"Dear colleague,\nhere is the mesh.\n", "text.vtk cannot be read as a mesh"),
        ("text.msh", b"Dear colleague,\nhere is the mesh.\n", "text.msh cannot be read as a mesh"),
        (
            "grid.vtu",
            b'<?xml version="1.0"?><VTKFile type="PolyData"></VTKFile>',
            "cannot be read .*holds no Unstructured",
        ),
        ("end.msh", b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n", "end.msh"),
        ("ansys.msh", b'(1 "x")\n(2 3)\n', "it does not begin as Gmsh's files do, with .MeshFormat"),
        ("end.bdf", b"BEGIN BULK\n", "end.bdf cannot be read as a mesh .*ends too early"),
    ],
)
def test_hostile_files(name, content, message, tmp_path, capfd):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(vx.MeshError, match=message):
        read(tmp_path / name)
    assert capfd.readouterr() == ("", "")


def test_a_folder_is_no_file(tmp_path):
    (tmp_path / "mesh.vtu").mkdir()
    with pytest.raises(vx.MeshError, match="is a folder"):
        read(tmp_path / "mesh.vtu")


def attempt(path):
    try:
        return read(path)
    except vx.MeshError as error:
        return error


@pytest.mark.parametrize("suffix", [".vtu", ".vtk", ".msh"])
def test_truncated_files(suffix, tmp_path, capfd):
    mesh = vx.meshes.triangles(2)
    mesh.write(tmp_path / f"mesh{suffix}")
    whole = (tmp_path / f"mesh{suffix}").read_bytes()
    for part in range(1, 10):
        (tmp_path / f"part{suffix}").write_bytes(whole[: len(whole) * part // 10])
        outcome = attempt(tmp_path / f"part{suffix}")
        if isinstance(outcome, vx.MeshError):
            assert f"part{suffix}" in str(outcome)
        else:  # what is missing is data at the end; cells and points are all there
            np.testing.assert_array_equal(outcome.vertices, mesh.vertices)
            np.testing.assert_array_equal(outcome.points, mesh.points)
    assert isinstance(attempt(tmp_path / f"mesh{suffix}"), PolygonMesh)
    assert capfd.readouterr() == ("", "")


def test_fields_on_a_mesh(tmp_path):
    mesh = vx.meshes.voronoi(4, seed=3)
    random = np.random.default_rng(0)
    at_nodes = {"displacement": random.random((mesh.n_nodes, 2)), "pressure": random.random(mesh.n_nodes)}
    on_cells = {"stress": random.random((mesh.n_cells, 3)), "energy": random.random(mesh.n_cells)}
    write_cells(tmp_path / "step.vtu", packed_cells(mesh), at_nodes, on_cells)
    file = meshio.read(tmp_path / "step.vtu")
    np.testing.assert_array_equal(file.point_data["displacement"][:, :2], at_nodes["displacement"])
    assert file.point_data["displacement"].shape == (mesh.n_nodes, 3)
    assert not file.point_data["displacement"][:, 2].any()
    np.testing.assert_array_equal(file.point_data["pressure"], at_nodes["pressure"])
    again = read(tmp_path / "step.vtu")
    np.testing.assert_array_equal(again.vertices, mesh.vertices)
    np.testing.assert_array_equal(again.cell_data["stress"], on_cells["stress"])
    np.testing.assert_array_equal(again.cell_data["energy"], on_cells["energy"])


@pytest.mark.long
def test_meshio_interchanges_no_fields(tmp_path):
    """It replaces the offsets of arrays one after the other, and may meet a new one where it looks for an old one."""
    mesh, random = vx.meshes.squares(3), np.random.default_rng(0)
    for trial in range(20):
        fields = {f"field {k}": random.random(mesh.n_nodes) * (random.random(mesh.n_nodes) < 0.2) for k in range(60)}
        write_cells(tmp_path / "step.vtu", packed_cells(mesh), fields, {})
        found = meshio.read(tmp_path / "step.vtu").point_data
        assert [name for name in fields if not np.array_equal(found[name], fields[name])] == [], trial


@pytest.mark.parametrize(
    ("name", "point_data", "cell_data", "message"),
    [
        ("step.vtk", {}, {}, "fields are written as .vtu files; got the suffix '.vtk'"),
        ("step.vtu", {"u": np.zeros((3, 2))}, {}, r"point field 'u' needs 9 rows; got shape \(3, 2\)"),
        ("step.vtu", {}, {"s": 1.0}, r"cell field 's' needs 4 rows; got shape \(\)"),
    ],
)
def test_fields_that_do_not_fit(name, point_data, cell_data, message, tmp_path):
    with pytest.raises(vx.MeshError, match=message):
        write_cells(tmp_path / name, packed_cells(vx.meshes.squares(2)), point_data, cell_data)


@pytest.mark.long
def test_meshio_is_loaded_late():
    code = "import sys, vemcvx as vx; vx.meshes.voronoi(3); print('meshio' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


def test_names_that_are_too_long():
    with pytest.raises(vx.MeshError, match="there is no such file"):
        vx.meshes.read("x" * 300 + ".vtu")
    with pytest.raises(vx.MeshError, match="vtu cannot be written"):
        vx.meshes.squares(2).write("x" * 300 + ".vtu")
