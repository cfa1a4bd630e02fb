"""Files that hung a reader of meshio, took gigabytes, or gave data that do not fit: all are refused, soon."""

from __future__ import annotations

import base64
import lzma
import re
import zlib

import hostile
import meshio
import numpy as np
import polydata
import pytest
from meshio.gmsh import main as gmsh

import vemcvx as vx

DATA = b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n$EndNodes\n$Elements\n$EndElements\n$ElementData\n"
FLAT = "\n".join(f"{n}, {x}, {y}" for n, (x, y) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)], 1))
ABAQUS = f"*NODE\n{FLAT}\n*ELEMENT, TYPE=CPS4\n1, 1, 2, 3, 4\n*ELSET, ELSET=all, GENERATE\n1, 1, 1\n".encode()
GRID = (
    b"# vtk DataFile Version 4.2\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 3 2 1\nORIGIN 0 0 0\nSPACING 1 1 1\n"
)
NODES = b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 1 1 300000000\n2 1 0 1\n300000000\n0 0 0\n$EndNodes\n"

HOSTILE = {
    "strings.msh": (DATA + b"1000000000000\n$EndElementData\n", "claims 1000000000000 strings; there is room for 2"),
    "reals.msh": (
        DATA + b"1\nx\n" + b"9" * 19 + b"\n$EndElementData\n",
        "claims 9999999999999999999 reals; there is room for 4",
    ),
    "items.msh": (DATA + b"0\n0\n3\n0\n1\n300000000\n$EndElementData\n", "claims 300000000 entries"),
    "nodes.msh": (
        DATA.replace(b"2.2 0", b"2.2 1").replace(b"$Nodes\n", b"$Nodes\n300000000\n"),
        "claims 300000000 entries",
    ),
    "number.msh": (NODES, "has the number 300000000; nodes and elements have less than 100,000,000: renumber them"),
    "set.inp": (ABAQUS.replace(b"1, 1, 1\n", b"1, 2000000000, 1\n"), "a set of it has 1999999999 members"),
    "grid.vtk": (GRID.replace(b"3 2 1", b"100000 100000 1"), "it is a STRUCTURED_POINTS; wanted are UNSTRUCTURED"),
    "end.bdf": (b"BEGIN BULK\n", "ends too early"),
}


@pytest.mark.long
def test_files_that_would_hang_a_reader_or_fill_the_memory(tmp_path):
    """What hangs, or is the first to take two gigabytes, is the last that the process has begun to read."""
    for name, (data, _) in HOSTILE.items():
        (tmp_path / name).write_bytes(data)
    said = hostile.read_all([tmp_path / name for name in HOSTILE])
    for (name, (_, says)), words in zip(HOSTILE.items(), said, strict=True):
        assert says in words, (name, words)


def test_sets_that_are_generated(tmp_path):
    (tmp_path / "set.inp").write_bytes(ABAQUS)
    with pytest.warns(vx.MeshWarning, match="by their place"):
        assert vx.meshes.read(tmp_path / "set.inp").cell_data["all"].tolist() == [1]


@pytest.mark.long
@pytest.mark.parametrize("version", ["2.2", "4.0", "4.1"])
def test_binary_files_of_gmsh(version, tmp_path):
    """Read; with a count or the number of a node that is gigabytes they are refused."""
    points, cells = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]), np.array([(0, 1, 2), (0, 2, 3)])
    tags = {
        "gmsh:physical": [np.ones(2, dtype=int)],
        "gmsh:geometrical": [np.ones(2, dtype=int)],
        "a": [np.arange(2.0)],
    }
    path = tmp_path / "sound.msh"
    gmsh.write(str(path), meshio.Mesh(points, [("triangle", cells)], cell_data=tags), version, binary=True)
    with pytest.warns(vx.MeshWarning, match="by their place"):
        assert vx.meshes.read(path).cell_data["a"].tolist() == [0, 1]
    data, paths = path.read_bytes(), []
    for section in (b"$Nodes\n", b"$Elements\n"):
        start = data.index(section) + len(section)
        for at in range(start, min(start + 90, data.index(b"$End", start)), 4):
            for byte in (b"\x40", b"\x7f"):
                paths.append(tmp_path / f"{section[1:6].decode()}{at}{byte.hex()}.msh")
                paths[-1].write_bytes(data[: at + 3] + byte + data[at + 4 :])
    said = hostile.read_all(paths)
    if version != "2.2":
        assert sum("claims" in words for words in said) >= 8
        assert any("renumber them" in words for words in said)


def offsets_beyond_the_end(folder):
    """Files of VTK whose last cell claims half a billion nodes, or whose middle one does."""
    mesh = vx.meshes.voronoi(2)
    for version in ("4.2", "5.1"):
        data = polydata.legacy(mesh, version)
        kind, last = (">i8", mesh.offsets[-1]) if version == "5.1" else (">i4", len(mesh.cells[-1]))
        ends = mesh.offsets if version == "5.1" else np.insert(mesh.vertices, mesh.offsets[:-1], np.diff(mesh.offsets))
        stream = np.asarray(ends).astype(kind)
        at = len(stream) - 2 if version == "5.1" else len(stream) - 1 - int(last)
        wrong = stream.copy()
        wrong[at] = 5 * 10**8
        yield folder / f"{version}.vtk", data.replace(stream.tobytes(), wrong.tobytes())
    text = polydata.xml(mesh).decode()
    ends = " ".join(map(str, mesh.offsets[1:].tolist()))
    yield folder / "offsets.vtp", text.replace(ends, ends.replace(ends.split()[1], "500000000")).encode()
    meshio.Mesh(mesh.points, mesh.to("meshio").cells).write(folder / "sound.vtu", binary=False)
    text = (folder / "sound.vtu").read_text()
    ends = re.search('Name="offsets"[^>]*>([^<]*)<', text)[1]
    yield folder / "offsets.vtu", text.replace(ends, ends.replace(ends.split()[1], "500000000", 1)).encode()


@pytest.mark.long
def test_cells_that_lead_beyond_the_end(tmp_path):
    """meshio numbers the nodes that a cell claims: half a billion are four gigabytes."""
    paths = []
    for path, data in offsets_beyond_the_end(tmp_path):
        path.write_bytes(data)
        paths.append(path)
    for says in hostile.read_all(paths):
        assert re.search("there is room for|lead beyond the end", says), says


@pytest.mark.long
@pytest.mark.parametrize("compression", ["zlib", "lzma"])
@pytest.mark.parametrize("place", ["inline", "appended", "raw"])
def test_arrays_that_unpack_to_more_than_their_size_lets_expect(compression, place, tmp_path):
    """Two gigabytes of zeros in a file of two megabytes; here a hundredth of that."""
    mesh, path = vx.meshes.squares(2), tmp_path / "mesh.vtu"
    mesh.to("meshio").write(path, compression=compression)
    sound = path.read_bytes()
    blocks = [{"zlib": zlib, "lzma": lzma}[compression].compress(bytes(40_000_000))]
    header = np.array([1, 40_000_000, 40_000_000, len(blocks[0])], dtype=np.uint32).tobytes()
    bomb = base64.b64encode(header) + base64.b64encode(blocks[0])
    array = b'<DataArray type="Float64" Name="z" '
    if place == "inline":
        data = sound.replace(b"<CellData>", b"<CellData>" + array + b'format="binary">' + bomb + b"</DataArray>")
    else:
        encoding, body = (b"base64", bomb) if place == "appended" else (b"raw", header + blocks[0])
        data = sound.replace(b"<CellData>", b"<CellData>" + array + b'format="appended" offset="0"/>')
        data = data.replace(
            b"</VTKFile>", b'<AppendedData encoding="%s">_%s\n</AppendedData></VTKFile>' % (encoding, body)
        )
    assert data != sound
    path.write_bytes(data)
    with pytest.raises(vx.MeshError, match="mesh.vtu cannot be read as a mesh: it unpacks to more than 200 times its"):
        vx.meshes.read(path)
    path.write_bytes(sound)
    assert vx.meshes.read(path).n_cells == 4


def test_a_reader_that_gives_fewer_data_than_cells(tmp_path):
    """The reference of the first cell is no number: meshio's reader of Nastran's files keeps one datum for four."""
    points, cells = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]), np.array([(0, 1, 2), (0, 2, 3)])
    meshio.Mesh(points, [("triangle", cells), ("line", cells[:, :2])]).write(tmp_path / "mesh.bdf")
    text = (tmp_path / "mesh.bdf").read_text()
    (tmp_path / "mesh.bdf").write_text(text.replace("CTRIA3  1 ", "CTRIA3  4294967295 "))
    with pytest.raises(vx.MeshError, match="mesh.bdf cannot be read as a mesh: its cell datum 'nastran:ref'"):
        vx.meshes.read(tmp_path / "mesh.bdf")


@pytest.mark.parametrize(
    ("name", "parts", "says"),
    [
        ("a", [np.zeros(1), np.zeros(1)], r"'a' has the shape \(1,\) on 2 cells"),
        ("a", [np.zeros(()), np.zeros(1)], r"'a' has the shape \(\) on 2 cells"),
        ("a", [np.zeros((2, 3)), np.zeros(1)], r"'a' has values of different shapes: \(\), \(3,\)"),
        ("boundary:floor", [np.zeros((2, 3)), np.zeros((1, 3))], r"'boundary:floor' has the shape \(3, 3\) on 3 cells"),
    ],
)
def test_data_that_do_not_fit(name, parts, says):
    points = [(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)]
    mesh = meshio.Mesh(points, [("triangle", [(0, 1, 2), (0, 2, 3)]), ("quad", [(1, 4, 5, 2)])])
    mesh.cell_data[name] = parts
    with pytest.raises(vx.MeshError, match=f"the mesh of meshio.*its cell datum {says}"):
        vx.meshes.convert(mesh)


def test_files_of_several_pieces(tmp_path):
    """Of two pieces meshio keeps all points, and the cells of the last."""
    vx.meshes.squares(2).write(tmp_path / "mesh.vtu")
    data = (tmp_path / "mesh.vtu").read_bytes()
    piece = data[data.index(b"<Piece") : data.index(b"</Piece>") + len(b"</Piece>")]
    (tmp_path / "mesh.vtu").write_bytes(data.replace(piece, piece + piece))
    with pytest.raises(vx.MeshError, match="mesh.vtu cannot be read as a mesh: it holds 2 pieces; wanted is one"):
        vx.meshes.read(tmp_path / "mesh.vtu")


def test_names_of_lines_that_there_are_none_of():
    """A file of solids whose solids are lost, say: its boundaries are marked on polygons."""
    points, cells = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]), np.array([(0, 1, 2), (0, 2, 3)])
    mesh = meshio.Mesh(points, [("triangle", cells)], cell_data={"boundary:floor": [np.array([0, 1])]})
    with pytest.warns(vx.MeshWarning, match="by their place"):
        assert set(vx.meshes.convert(mesh).boundaries) == {"left", "right", "bottom", "top", "boundary"}


def test_cells_of_more_nodes_than_their_kind_has(tmp_path):
    text = polydata.POLYHEDRA.replace("42 12 9<", "42 12 5<")
    (tmp_path / "mesh.vtu").write_text(text)
    with pytest.raises(vx.MeshError, match="its cells of the kind 'triangle' do not all have 3 nodes"):
        vx.meshes.read(tmp_path / "mesh.vtu")
