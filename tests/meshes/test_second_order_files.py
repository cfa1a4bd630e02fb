"""Cells of second order in files are read by their corners, and how many nodes between these are dropped is said."""

import meshio
import numpy as np
import pytest

import vemcvx as vx

MIDDLE = {
    "triangle": ([(0, 1), (1, 2), (2, 0)], []),
    "quad": ([(0, 1), (1, 2), (2, 3), (3, 0)], [(0, 1, 2, 3)]),
    "line": ([(0, 1)], []),
    "tetra": ([(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)], []),
    "hexahedron": (
        [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)],
        [(0, 3, 4, 7), (1, 2, 5, 6), (0, 1, 4, 5), (2, 3, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7), tuple(range(8))],
    ),
}  # fmt: skip


def curved(points, blocks, serendipity):
    """The same blocks of cells with nodes in the middle of edges, and of faces and cells unless `serendipity`."""
    places, number, found = [tuple(p) for p in np.asarray(points, dtype=float)], {}, []
    for kind, cells in blocks:
        edges, others = MIDDLE[kind]
        rows = []
        for cell in np.asarray(cells):
            row = list(cell)
            for some in [*edges, *([] if serendipity else others)]:
                key = frozenset(int(cell[k]) for k in some)
                if key not in number:
                    number[key] = len(places)
                    places.append(tuple(np.mean([places[k] for k in key], axis=0)))
                row.append(number[key])
            rows.append(row)
        found.append((f"{kind}{len(rows[0])}", np.array(rows)))
    return np.array(places), found


def grid(kind):
    """Points and blocks of a square or a cube, and of what bounds it below."""
    if kind in ("triangle", "quad"):
        mesh = (vx.meshes.triangles if kind == "triangle" else vx.meshes.squares)(3)
        points = np.pad(mesh.points, ((0, 0), (0, 1)))
        return mesh, points, [(kind, np.array(mesh.cells)), ("line", mesh.boundaries["bottom"])]
    mesh = (vx.meshes.tetrahedra if kind == "tetra" else vx.meshes.cubes)(2)
    made = mesh.to("meshio")
    cells = np.concatenate([block.data for block in made.cells if block.type == kind])
    return mesh, np.asarray(made.points), [(kind, cells)]


@pytest.mark.parametrize("suffix", [".vtu", ".msh"])
@pytest.mark.parametrize(
    ("kind", "serendipity"),
    [("triangle", True), ("quad", True), ("quad", False), ("tetra", True), ("hexahedron", True), ("hexahedron", False)],
)
def test_cells_are_read_by_their_corners(tmp_path, kind, serendipity, suffix):
    first, points, blocks = grid(kind)
    if suffix == ".vtu":
        blocks = blocks[:1]
    places, cells = curved(points, blocks, serendipity)
    data = {}
    if len(blocks) > 1:
        marks = [np.full(len(block), tag) for tag, (_, block) in enumerate(cells, start=1)]
        data = {"cell_data": {"gmsh:physical": marks, "gmsh:geometrical": marks}}
        data |= {"field_data": {"plate": np.array([1, 2]), "floor": np.array([2, 1])}}
    path = tmp_path / f"curved{suffix}"
    meshio.Mesh(places, cells, **data).write(path, **({"file_format": "gmsh22"} if suffix == ".msh" else {}))
    with pytest.warns(vx.MeshWarning) as caught:
        mesh = vx.meshes.read(path)
    said = [str(one.message) for one in caught if "second-order" in str(one.message)]
    kinds = ", ".join(sorted(name for name, _ in cells))
    assert said == [
        f"{path}: {len(places) - len(points)} nodes between the corners of second-order cells ({kinds}) are dropped: "
        "cells are read by their corners, with straight edges."
    ]
    assert not any("belong to no cell" in str(one.message) for one in caught)
    np.testing.assert_allclose(mesh.points, first.points, atol=1e-15)
    assert mesh.n_cells == first.n_cells
    if len(blocks) > 1:
        assert len(mesh.boundaries["floor"]) == 3
        assert np.abs(mesh.points[mesh.boundaries["floor"].ravel(), 1]).max() == 0.0


def test_cells_of_second_order_make_bodies(tmp_path):
    points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (2, 1, 0)]
    places, cells = curved(points, [("quad", [[0, 1, 4, 3], [1, 2, 5, 4]])], serendipity=True)
    path, tags = tmp_path / "two.msh", [np.array([1, 2])]
    names = {"left": np.array([1, 2]), "right": np.array([2, 2])}
    data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    meshio.Mesh(places, cells, cell_data=data, field_data=names).write(path, file_format="gmsh22")
    with pytest.warns(vx.MeshWarning) as caught:
        mesh = vx.meshes.read(path, bodies="physical")
    assert sum("7 nodes between the corners" in str(one.message) for one in caught) == 1
    assert mesh.n_cells == 2
    assert list(mesh.interfaces) == ["left|right"]


def test_nodes_that_cells_lack_are_told(tmp_path):
    """A cell of second order that names a node that is not there, or too few."""
    places, cells = curved([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [("triangle", [[0, 1, 2]])], serendipity=True)
    cells[0][1][0, 2] = 17
    path = tmp_path / "damaged.vtu"
    meshio.Mesh(places, cells).write(path)
    with pytest.raises(vx.MeshError, match="cell 0 names node 17"):
        vx.meshes.read(path)
