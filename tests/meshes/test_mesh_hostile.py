"""Files that hung a reader of meshio, or came through it with data that do not fit: all are refused, soon."""

from __future__ import annotations

import gzip
import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest

import vemcvx as vx
from vemcvx.meshes.io.blocks import Blocks
from vemcvx.meshes.io.unsafe import check_data

ROOT = Path(vx.__file__).parent.parent
SECONDS = 20
"""For all of them; without the check none of the files is done with in a minute."""

READER = """
import sys, vemcvx as vx
for path in sys.argv[1:]:
    print("reading", path, flush=True)
    try:
        vx.meshes.read(path)
    except vx.MeshError as error:
        print(error)
"""

RING = b"((0 0 0, 1 0 0, 1 1 0, 0 0 0))"
POINTS = "\n".join(f"GRID, {n + 1}, , {x}., {y}., 0." for n, (x, y) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]))
DATA = b"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n$EndNodes\n$Elements\n$EndElements\n$ElementData\n"

HANGING = {
    "coordinate.wkt": (
        b"TIN (" + b",".join([RING] * 3 + [RING.replace(b"1 1 0", b"1000000.5 1")] * 9),
        "well-known text",
    ),
    "open.wkt": (b"TIN (" + b",".join([RING] * 3) + b",((" + b"1" * 100_000, "well-known text"),
    "blanks.wkt": (b"TIN (" + RING + b" " * 100_000, "well-known text"),
    "points.msh": (b'(1 "x")\n(2 3)\n(3010 (1 1 6 1 3)(\n', "cannot be read"),
    "cells.msh": (b'(1 "x")\n(2 3)\n(10 (0 1 6 0))\n(3012 (1 1 0 1 3)(\n)', "ends too early"),
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
    "lines.msh": (b'(1 "x")\n(2 3)\n(10 (1 1 6 1 3)(\n0 0 0\n', "ends too early"),
    "blank.vol.gz": (gzip.compress(b"mesh3d\n" + b"\n" * 50_000_000), "unpacks to more than 200 times its size"),
}


def test_files_that_would_hang_a_reader(tmp_path):
    """What hangs is the last that the process has begun to read."""
    for name, (data, _) in HANGING.items():
        (tmp_path / name).write_bytes(data)
    command = [sys.executable, "-W", "error", "-c", READER, *(str(tmp_path / name) for name in HANGING)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, cwd=ROOT, check=True)
    said = [part.split("\n", 1)[1] for part in done.stdout.split("reading ")[1:]]
    for (name, (_, says)), words in zip(HANGING.items(), said, strict=True):
        assert words.startswith(str(tmp_path / name))
        assert says in words


@pytest.mark.parametrize("blanks", ["", " ", "\n \t"])
def test_sound_well_known_texts_are_read(blanks, tmp_path):
    rings = "((0 0. +0.0,@1 0 0,1.5 1 .0,0 0 0)),@((0 0 0, 1.5 1 0, -.5 1 0, 0 0 0))@)"
    text = ("TIN@(@" + rings).replace("@", blanks)
    (tmp_path / "mesh.wkt").write_text(text)
    mesh = vx.meshes.read(tmp_path / "mesh.wkt")
    assert mesh.points.tolist() == [[0, 0], [1, 0], [1.5, 1], [-0.5, 1]]
    assert [cell.tolist() for cell in mesh.cells] == [[0, 1, 2], [0, 2, 3]]


def test_sound_files_of_ansys_and_compressed_ones_are_read(tmp_path):
    points = np.array([(0.0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])
    for name, kind in (("mesh.msh", "ansys"), ("mesh.vol.gz", "netgen")):
        meshio.Mesh(points, [("triangle", np.array([(0, 1, 2), (0, 2, 3)]))]).write(tmp_path / name, file_format=kind)
        assert vx.meshes.read(tmp_path / name).n_cells == 2
    meshio.Mesh(points, [("triangle", np.array([(0, 1, 2), (0, 2, 3)]))], cell_data={"a": [np.arange(2.0)]}).write(
        tmp_path / "data.msh", file_format="gmsh22"
    )
    assert b"$ElementData" in (tmp_path / "data.msh").read_bytes()
    assert vx.meshes.read(tmp_path / "data.msh").cell_data["a"].tolist() == [0, 1]


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
        ("a", [np.zeros(1), np.zeros(1)], r"'a' has the shape \(1,\) on 2 cells \(triangle\)"),
        ("a", [np.zeros(()), np.zeros(1)], r"'a' has the shape \(\) on 2 cells"),
        ("a", [np.zeros((2, 3)), np.zeros(1)], r"'a' has values of different shapes: \(\), \(3,\)"),
        ("boundary:floor", [np.zeros((2, 3)), np.zeros((1, 3))], r"'boundary:floor' has values of different shapes"),
    ],
)
def test_data_that_do_not_fit(name, parts, says):
    blocks = Blocks([("triangle", np.zeros((2, 3), dtype=np.int64)), ("quad", np.zeros((1, 4), dtype=np.int64))])
    blocks.data[name] = parts
    with pytest.raises(vx.MeshError, match=says):
        check_data(blocks)
