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
from vemcvx.meshes.blocks import Blocks
from vemcvx.meshes.hostile import check_data

ROOT = Path(vx.__file__).parent.parent
SECONDS = 20
"""Starting Python takes one; without the check none of the files is done with in a minute."""

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
    "cells.msh": (b'(1 "x")\n(2 3)\n(10 (0 1 6 0))\n(3012 (1 0 1 1 3)(\n)', "ends too early"),
    "strings.msh": (DATA + b"1000000000000\n$EndElementData\n", "claims 1000000000000 tags in 2 lines"),
    "reals.msh": (DATA + b"1\nx\n" + b"9" * 19 + b"\n$EndElementData\n", "claims 9999999999999999999 tags in 4 lines"),
    "blank.vol.gz": (gzip.compress(b"mesh3d\n" + b"\n" * 50_000_000), "unpacks to more than 200 times its size"),
}


@pytest.mark.parametrize("name", HANGING)
def test_files_that_would_hang_a_reader(name, tmp_path):
    data, says = HANGING[name]
    (tmp_path / name).write_bytes(data)
    code = "import sys, vemcvx as vx\ntry:\n    vx.meshes.read(sys.argv[1])\nexcept vx.MeshError as error:\n    print(error)"
    command = [sys.executable, "-W", "error", "-c", code, str(tmp_path / name)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, cwd=ROOT, check=True)
    assert done.stdout.startswith(str(tmp_path / name))
    assert says in done.stdout


@pytest.mark.parametrize("blanks", ["", " ", "\n \t"])
def test_sound_well_known_texts_are_read(blanks, tmp_path):
    text = f"TIN{blanks}({blanks}((0 0. +0.0,{blanks}1 0 0,1.5 1 .0,0 0 0)),{blanks}((0 0 0, 1.5 1 0, -.5 1 0, 0 0 0)){blanks})"
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
    """An element number beyond 32 bits confuses the reader of Nastran's files: four cells, one datum."""
    cells = "CTRIA3, 4294967295, 1, 1, 2, 3\nCTRIA3, 2, 1, 1, 3, 4\nCBAR, 3, 1, 1, 2"
    (tmp_path / "mesh.bdf").write_text(f"BEGIN BULK\n{POINTS}\n{cells}\nENDDATA\n")
    try:
        mesh = vx.meshes.read(tmp_path / "mesh.bdf")
    except vx.MeshError as error:
        assert "datum" in str(error)
    else:
        assert mesh.n_cells == 2


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
