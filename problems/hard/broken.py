"""Broken meshes, data and files: each is refused in a sentence that names the fault. Unused nodes cause a warning."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import vemcvx as vx
from hard.case import REFUSAL, WARNING, Case
from hard.ground import block, on, shear_block

SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
TWO = [*SQUARE, (2.0, 0.0), (2.0, 1.0)]
BOTH = [[0, 1, 2, 3], [1, 4, 5, 2]]
MESH = vx.meshes.squares(4)


def mesh(name, points, cells, says, must=REFUSAL):
    return Case(name, lambda: shear_block(vx.PolygonMesh(points, cells)), must, says)


def file(name, suffix, says, change=lambda data: data):
    """Return the case of a mesh file with this suffix, whose content is modified by `change`."""

    def make():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"mesh{suffix}"
            vx.meshes.triangles(3).write(folder + "/sound.vtu")
            path.write_bytes(change((Path(folder) / "sound.vtu").read_bytes()))
            return on(vx.meshes.read(path))

    return Case(name, make, REFUSAL, says)


def bad(name, says, **settings):
    return Case(name, lambda: on(MESH, **settings), REFUSAL, says)


CASES = (
    mesh("a cell that crosses itself", SQUARE, [[0, 2, 1, 3]], "crosses itself"),
    mesh("a cell with a spike", [*SQUARE, (2, 0)], [[0, 4, 1, 2, 3]], "crosses or touches itself"),
    mesh("cells that overlap", [*SQUARE, (0.5, 0.4)], [[0, 1, 2, 3], [0, 1, 4]], "overlap"),
    mesh("a gap of 1e-9", [*SQUARE, (1 + 1e-9, 0), (2, 0), (2, 1), (1 + 1e-9, 1)], [[0, 1, 2, 3], [4, 5, 6, 7]], "gap"),
    mesh("a hanging node that one cell omits", [*TWO, (1, 0.5)], [[0, 1, 6, 2, 3], BOTH[1]], "hanging nodes included"),
    mesh("two nodes in one place", [*SQUARE, (0, 1)], [[0, 1, 2, 3], [0, 3, 4]], "same place"),
    mesh("a cell listed twice", SQUARE, [[0, 1, 2, 3], [0, 1, 2, 3]], "overlap"),
    mesh("a cell of two vertices", SQUARE, [[0, 1]], "at least 3"),
    mesh("a cell without area", [(0, 0), (1, 0), (2, 0)], [[0, 1, 2]], "no area"),
    mesh("NaN among the points", [*SQUARE[:3], (0, np.nan)], [[0, 1, 2, 3]], "must be finite"),
    mesh("infinity among the points", [*SQUARE[:3], (0, np.inf)], [[0, 1, 2, 3]], "must be finite"),
    mesh("points in space", np.zeros((4, 3)), [[0, 1, 2, 3]], "(n_nodes, 2)"),
    mesh("node numbers that are not whole", SQUARE, [[0.0, 1.0, 2.0]], "node numbers"),
    mesh("a node that is not there", SQUARE, [[0, 1, 7]], "names node 7"),
    mesh("no cells", SQUARE, [], "at least one cell"),
    Case(
        "a node that no cell uses",
        lambda: shear_block(vx.PolygonMesh([*(np.array(SQUARE) * [2, 0.5]), (9, 9)], [[0, 1, 2, 3]])),
        WARNING,
        "belong to no cell",
    ),
    file("a file cut short", ".vtu", "mesh.vtu", lambda data: data[: len(data) // 2]),
    file("a .vtu file that is a picture", ".vtu", "mesh.vtu", lambda data: b"\x89PNG\r\n" + bytes(200)),
    file("an empty file", ".vtu", "mesh.vtu", lambda data: b""),
    file("a file with an unknown suffix", ".docx", "mesh.docx"),
    Case("a format that is only read", lambda: MESH.write("mesh.msh"), REFUSAL, "written as .vtu files"),
    bad("NaN in the bound", "found NaN", bound=np.nan),
    bad("NaN in a modulus", "found NaN", young=np.where(np.arange(16) == 3, np.nan, 1.0)),
    bad("moduli of another mesh", "one per cell", young=np.ones(9)),
    Case("NaN in a later load", lambda: on(MESH, lambda t: np.nan if t > 0.5 else 0.0), REFUSAL, "found NaN"),
    bad("a boundary that is not there", "no boundary named 'rihgt'", clamp="rihgt"),
    Case("repeated instants", lambda: on(MESH, times=[0, 0.5, 0.5, 1]), REFUSAL, "wanted an increasing sequence"),
    Case("decreasing instants", lambda: on(MESH, times=[0, 1, 0.5]), REFUSAL, "wanted an increasing sequence"),
    Case(
        "a scene without material",
        lambda: vx.simulate(vx.Scene(*list(block())[1:]), MESH, [0, 1]),
        REFUSAL,
        "found 0 materials",
    ),
)
