"""Mesh files of other programs: order, groups, what is no plane mesh of polygons."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

import vemcvx as vx
from vemcvx.meshes import read

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def foreign(path, points, cells, **data):
    meshio.Mesh(points, cells, **data).write(path, **({"file_format": "gmsh22"} if path.suffix == ".msh" else {}))


def flat(points, z=0.0):
    return np.pad(np.asarray(points, dtype=float), ((0, 0), (0, 1)), constant_values=z)


def test_constant_height_is_dropped(tmp_path):
    foreign(tmp_path / "mesh.vtu", flat(SQUARE, 7.5), [("quad", [[0, 1, 2, 3]])])
    np.testing.assert_array_equal(read(tmp_path / "mesh.vtu").points, SQUARE)


def test_polygons_of_other_programs_keep_their_order(tmp_path):
    points = [*SQUARE, (2.0, 0.0), (2.0, 1.0), (0.5, 1.5)]
    cells = [("triangle", [[1, 4, 5]]), ("polygon", [[0, 1, 2, 6, 3]]), ("triangle", [[1, 5, 2]])]
    foreign(tmp_path / "mesh.vtu", flat(points), cells)
    assert [cell.tolist() for cell in read(tmp_path / "mesh.vtu").cells] == [[1, 4, 5], [0, 1, 2, 6, 3], [1, 5, 2]]


@pytest.mark.parametrize(
    ("points", "cells", "message"),
    [
        (np.column_stack([SQUARE, [0, 0, 0, 1]]), [("quad", [[0, 1, 2, 3]])], "z = constant: z runs from 0 to 1"),
        (flat(SQUARE), [("VTK_LAGRANGE_CURVE", [[0, 1, 2]])], "cells of the kind 'number 68 of VTK'"),
        (flat(SQUARE), [("line", [[0, 1]])], "it holds no polygons, only line"),
        (flat(SQUARE), [("quad", [[0, 2, 1, 3]])], "mesh.vtu: cell 0 has no area .* crosses itself"),
        (flat(SQUARE), [("quad", [[0, 1, 2, 9]])], "mesh.vtu: cell 0 names node 9"),
        (flat([*SQUARE[:3], (np.nan, 1)]), [("quad", [[0, 1, 2, 3]])], r"mesh.vtu: node 3 is at \(nan, 1.0\)"),
    ],
)
def test_files_of_other_things(points, cells, message, tmp_path):
    foreign(tmp_path / "mesh.vtu", points, [(kind, np.array(corners)) for kind, corners in cells])
    with pytest.raises(vx.MeshError, match=message):
        read(tmp_path / "mesh.vtu")


def test_mending_is_said_with_the_path(tmp_path):
    foreign(tmp_path / "mesh.vtu", flat([*SQUARE, (5, 5)]), [("quad", np.array([[3, 2, 1, 0]]))])
    with pytest.warns(vx.MeshWarning) as caught:
        mesh = read(tmp_path / "mesh.vtu")
    messages = [str(warning.message) for warning in caught]
    assert all(message.startswith(f"{tmp_path / 'mesh.vtu'}: ") for message in messages)
    assert "clockwise" in messages[0]
    assert "dropped" in messages[1]
    assert messages[2].endswith(
        "no part of the boundary has a name; by their place, sides are called left, right, bottom, top."
    )
    assert len(messages) == 3
    assert caught[0].filename == __file__
    assert mesh.node_map.tolist() == [0, 1, 2, 3, -1]


GMSH = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
3
1 1 "floor"
2 5 "steel"
2 6 "all of it"
$EndPhysicalNames
$Entities
4 5 2 0
1 0 0 0 0
2 1 0 0 0
3 1 1 0 0
4 0 1 0 0
1 0 0 0 1 0 0 1 1 2 1 -2
2 1 0 0 1 1 0 1 9 2 2 -3
3 1 1 0 0 1 0 0 2 3 -4
4 0 1 0 0 0 0 0 2 4 -1
5 0 0 0 1 1 0 1 7 2 1 -3
1 0 0 0 1 1 0 2 5 6 3 1 2 -5
2 0 0 0 1 1 0 1 6 3 5 3 4
$EndEntities
$Nodes
1 4 1 4
2 1 0 4
1
2
3
4
0 0 0
1 0 0
1 1 0
0 1 0
$EndNodes
$Elements
5 5 1 5
1 1 1 1
1 1 2
1 2 1 1
2 2 3
1 5 1 1
3 1 3
2 1 2 1
4 1 2 3
2 2 2 1
5 1 3 4
$EndElements
"""


def test_groups_of_gmsh(tmp_path, capfd):
    """Named and nameless lines, lines inside the domain, a surface in two groups."""
    (tmp_path / "mesh.msh").write_text(GMSH)
    with pytest.warns(vx.MeshWarning, match="1 of 1 lines named '7' are not on the boundary and are left out"):
        mesh = read(tmp_path / "mesh.msh")
    assert [cell.tolist() for cell in mesh.cells] == [[0, 1, 2], [0, 2, 3]]
    assert mesh.boundaries["floor"].tolist() == [[0, 1]]
    assert mesh.boundaries["9"].tolist() == [[1, 2]]
    assert set(mesh.boundaries) == {"floor", "9", "boundary"}
    assert mesh.cell_data["steel"].tolist() == [1, 0]
    assert mesh.cell_data["all of it"].tolist() == [1, 1]
    assert capfd.readouterr() == ("", "")


def test_a_group_called_boundary_must_be_the_boundary(tmp_path):
    (tmp_path / "mesh.msh").write_text(GMSH.replace("floor", "boundary"))
    with pytest.raises(vx.MeshError, match="mesh.msh: the name 'boundary' is taken"):
        read(tmp_path / "mesh.msh")


def test_sets_of_other_programs_become_names(tmp_path):
    (tmp_path / "mesh.inp").write_text(
        "*NODE\n1, 0, 0\n2, 1, 0\n3, 1, 1\n4, 0, 1\n*ELEMENT, TYPE=CPS3\n1, 1, 2, 3\n2, 1, 3, 4\n"
        "*ELSET, ELSET=soft\n2\n"
    )
    assert read(tmp_path / "mesh.inp").cell_data["soft"].tolist() == [0, 1]


def test_lines_to_nodes_that_do_not_exist(tmp_path):
    lines = ("line", np.array([[0, 1], [3, 77]]))
    marks = {"boundary:floor": [np.array([0]), np.array([1, 1])]}
    foreign(tmp_path / "mesh.vtu", flat(SQUARE), [("quad", np.array([[0, 1, 2, 3]])), lines], cell_data=marks)
    with pytest.warns(vx.MeshWarning, match="1 of 2 lines named 'floor' are not on the boundary"):
        mesh = read(tmp_path / "mesh.vtu")
    assert mesh.boundaries["floor"].tolist() == [[0, 1]]
