"""Mesh files of other programs: their contents, refusals that name the cause, and damaged files."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import meshio
import numpy as np
import pytest
from hostile import mutated, read_all
from scenes import small

import vemcvx as vx
from vemcvx.meshes import read

FILES = Path(__file__).parent / "files"
SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
FLAT = "*NODE\n1, 0, 0\n2, 1, 0\n3, 1, 1\n4, 0, 1\n"
DECK, TWICE, WITHIN, TWO, BULK, GMSH, POLYHEDRA = (
    (FILES / name).read_text()
    for name in (
        *("many_spellings.inp", "one_part_twice.inp", "meshes_in_instances.inp", "two_blocks.inp"),
        *("three_layouts.bdf", "groups_41.msh", "polyhedra.vtu"),
    )
)


@pytest.fixture
def read_text(tmp_path):
    """Return a function that writes a text to a file and reads the file."""

    def write_and_read(suffix, text, **options):
        path = tmp_path / f"mesh{suffix}"
        path.write_text(text)
        return read(path, **options)

    return write_and_read


STEEL = [(-1.5e-3, 0.0), (1.5e-3, 0.0), (1.5e-3, 2.5e-3), (-1.5e-3, 2.5e-3)]
READ = {
    "a3_elset_second.inp": {"data": {"STEEL": [0, 0, 1]}},
    "b11_second_elset_missing_first.inp": {"data": {"STEEL": [1, 1]}, "named": ("left", "right", "bottom", "top")},
    "b1_comment_in_elements.inp": {"cells": 2},
    "a2_instance_moved.inp": {"cells": 1, "points": (SQUARE + np.array([5.0, 7.0])).tolist()},
    "a7_cpe4.inp": {"cells": 1},
    "b5_surface.inp": {"data": {"P": [1]}, "named": ("FLOOR", "CEILING")},
    "a8b_include.inp": {"data": {"PLATE": [1]}},
    "n4b_large_mixed.bdf": {"cells": 2},
    "n2_theta.bdf": {"cells": 1},
    "n1b_D_exp.bdf": {"cells": 1, "points": list(map(list, STEEL))},
    "n5_no_begin.bdf": {"cells": 1},
    "g9_samename_22.msh": {"data": {"steel": [1, 1]}, "named": ("steel",)},
    "g3_saveall_41.msh": {"data": {"all": [1, 1], "steel": [0, 1]}, "named": ("floor", "outer")},
}
"""File -> expected cells, cell data, points or boundaries."""
REFUSED = {
    "a1_two_parts.inp": "nodes 3 and 4 are in the same place.* If 'Lower-1', 'Upper-1' are bodies, "
    ".*='physical'; vemcvx run --mesh does so if the scene names .*'Lower-1.NAME'",
    "b10_elgen.inp": r"its keyword \*ELGEN is not supported; write out",
    "n3_cyl.bdf": "GRID 1 is in the coordinate system 10; export nodes in the basic one",
    "g4_parametric_22.msh": ".*nodes have parametric coordinates",
}


@pytest.mark.parametrize("name", [*READ, *REFUSED])
def test_files_of_users_are_read_or_refused_with_the_cause(name, capfd):
    if name in READ:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*were not read: elements of the type T2D2")
            mesh, wanted = read(FILES / name), READ[name]
        data = wanted.get("data", {})
        assert {key: mesh.cell_data[key].tolist() for key in data} == data
        assert mesh.n_cells == wanted.get("cells", len(next(iter(data.values()), ())))
        assert set(mesh.boundaries) == {*wanted.get("named", set(mesh.boundaries)), "boundary"}
        assert mesh.points.tolist() == wanted.get("points", mesh.points.tolist())
    else:
        with pytest.raises(vx.MeshError, match=f"{name}: {REFUSED[name]}"):
            read(FILES / name)
    assert capfd.readouterr() == ("", "")


def test_files_of_users_keep_names_and_become_bodies():
    named = read(FILES / "b5_surface.inp")
    assert named.boundaries["FLOOR"].tolist() == [[0, 1]]
    assert named.boundaries["CEILING"].tolist() == [[2, 3]]
    two = read(FILES / "a1_two_parts.inp", bodies="physical")
    assert list(two.interfaces) == ["Lower-1|Upper-1"]
    assert two.measures.tolist() == [1.0, 9.0]
    for name, words in (("g3_saveall_41.msh", "'all' with 2 cells, 'steel' with 1 cells; 0 .*, 1 in several"),
                        ("a3_elset_second.inp", ".*2 cells are in no body"),
                        ("a8b_include.inp", "'PLATE' with 1 cells"),
                        ("a7_cpe4.inp", "there is none")):  # fmt: skip
        source = "physical group of cells" if ".msh" in name else "instance or part, or else of every element set"
        with pytest.raises(vx.MeshError, match=f"{name}: .* makes a body of every {source}.*; here {words}"):
            read(FILES / name, bodies="physical")


def test_every_cell_of_a_rod_has_the_material_of_its_set():
    """Pull a rod of three cells. The last cell is stiffer by a factor of 100."""
    mesh = read(FILES / "a3_elset_second.inp").with_cell_data("SOFT", [1, 1, 0])
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.0, on="SOFT"),
        vx.Elasticity(100.0, 0.0, on="STEEL"),
        vx.Clamp(on="left"),
        vx.Traction((1.0, 0.0), on="right"),
    )
    u = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled").displacement[-1, :, 0]
    assert u[1:4] == pytest.approx([1.0, 2.0, 2.01], rel=1e-9)


# Abaqus.


def test_a_deck_may_use_every_spelling(read_text):
    with pytest.warns(
        vx.MeshWarning,
        match=r"were not read: the surface free .*both; only sides .* are read., elements of the type CAX4",
    ):
        mesh = read_text(".inp", DECK)
    assert mesh.points.tolist() == [*SQUARE.tolist(), [2.0, 0.0], [2.0, 1.0]]
    assert {name: values.tolist() for name, values in mesh.cell_data.items()} == {
        "Left": [1, 0],
        "RIGHT": [0, 1],
        "both": [1, 1],
    }
    assert {
        name: sorted(map(sorted, edges.tolist())) for name, edges in mesh.boundaries.items() if name != "boundary"
    } == {
        "top": [[2, 3], [2, 5]],
        "far": [[4, 5]],
        "Everything": sorted(map(sorted, mesh.boundaries["boundary"].tolist())),
        "Floor": [[0, 1], [1, 4]],
        "ends": [[0, 1], [1, 4]],
    }


def test_instances_are_bodies_after_translation_and_rotation(read_text):
    """Place one part twice. The second instance is moved up by 1, and rotated about its centre by 90 degrees."""
    mesh = read_text(".inp", TWICE, bodies="physical")
    np.testing.assert_allclose(mesh.centroids, [(0.5, 0.5), (0.5, 1.5)], rtol=1e-15)
    assert {name: of.bodies for name, of in mesh.interfaces.items()} == {"roof": ("low", "high")}
    middles = {name: mesh.points[edges].mean(axis=(0, 1)).round(12).tolist() for name, edges in mesh.boundaries.items()}
    assert middles == {
        "low.base": [0.5, 0.0],
        "low.hold": [0.5, 0.0],
        "high.base": [1.0, 1.5],
        "high.side": [0.0, 1.5],
        "roof": [0.5, 1.0],
        "boundary": [0.5, 1.0],
    }
    assert mesh.cell_data["Iron"].tolist() == [1, 1]
    assert mesh.cell_data["high.Iron"].tolist() == [0, 1]  # the set of one instance
    assert mesh.cell_data["high"].tolist() == [0, 1]


def test_a_part_without_an_end_is_read(read_text):
    """Omit *END PART. The part ends with the file or at the first instance."""
    assert read_text(".inp", TWICE.partition("*END PART")[0]).n_cells == 1
    assert read_text(".inp", TWICE.replace("*END PART\n", ""), bodies="physical").n_cells == 2


def test_nodes_within_an_instance_are_translated_and_rotated_with_it(read_text):
    """Define meshes within instances. The upper instance is moved up by 1, and rotated by 180 degrees."""
    words = r"mesh\.inp: .* not read: .*nodes of toe that do not exist"
    with pytest.warns(vx.MeshWarning, match=words):
        mesh = read_text(".inp", WITHIN, bodies="physical")
    assert mesh.points[4:8] == pytest.approx(np.array([(1, 3), (0, 3), (0, 1), (1, 1)]), abs=1e-15)


def test_a_part_whose_elements_are_not_read_is_no_body(read_text):
    text = "CPS44\n1, 1, 2, 3, 4\n*NSET"
    words = "'low' with 1 cells, 'high' with 0 cells; .* these parts .* not read: .*elements of the type CPS44 in high"
    with pytest.raises(vx.MeshError, match=words):
        read_text(".inp", WITHIN.replace("CPS4\n1, 1, 2, 3, 4\n*NSET", text), bodies="physical")


def test_a_name_on_part_of_an_interface_names_this_part(read_text):
    """Name a set "toe" on the second body. The boundary "toe" has edges of the first body."""
    mesh = read_text(".inp", TWO, bodies="physical")
    assert mesh.interfaces["foot"].bodies == ("low", "high")
    toe = mesh.boundaries["toe"].tolist()
    assert toe in [[edge] for edge in mesh.interfaces["foot"].edges.tolist()]
    assert sorted(mesh.points[toe[0]].tolist()) == [[0.0, 1.0], [1.0, 1.0]]
    scene = vx.Scene(vx.Elasticity(1.0, 0.3), vx.UnilateralContact(on="high|low"))
    with pytest.raises(vx.SceneError, match="no boundary named 'high.low'; this interface is named 'foot'"):
        vx.simulate(scene, mesh, [0.0, 1.0])


def test_bodies_with_a_gap_have_no_interface(read_text):
    mesh = read_text(".inp", re.sub(r"^(1[123], .*, )1\.$", r"\g<1>1.25", TWO, flags=re.M), bodies="physical")
    scene = vx.Scene(vx.Elasticity(1.0, 0.3), vx.UnilateralContact(on="foot"))
    with pytest.raises(vx.SceneError, match="outside interfaces it is named 'high.foot'; if two bodies should touch"):
        vx.simulate(scene, mesh, [0.0, 1.0])


def test_unsupported_decks_are_refused_with_the_cause(read_text):
    quad, triangle = FLAT + "*ELEMENT, TYPE=CPS4\n", FLAT + "*ELEMENT, TYPE=CPS3\n1, 1, 2, 3\n"
    for deck, subject in (
        ("*NODE, SYSTEM=C\n1, 1., 30.\n", r"its keyword \*NODE, SYSTEM=C is not supported"),
        ("*INSTANCE, NAME=a, LIBRARY=old\n", r"its keyword \*INSTANCE, LIBRARY=old is not supported"),
        ("*INSTANCE, NAME=a, PART=b\n", "its instance a belongs to the part b, which does not exist"),
        ("*INCLUDE, INPUT=none.inp\n", "No such file .*none.inp"),
        ("*INCLUDE, INPUT=mesh.inp\n", "RecursionError"),
        (quad + "1, 1, 2, 3\n", "its elements of the type CPS4 do not all have 4 nodes"),
        (quad.replace("CPS4", "CAX4") + "1, 1, 2, 3, 4\n", "no polygons, .*were not read: elements of the type CAX4"),
        (quad + "1, 1, 2, 3, 9\n", "its element 1 has the node 9, which does not exist"),
        (triangle + "*SURFACE, NAME=a\n1, S4\n", "the side S4 of a triangle, which does not exist"),
    ):
        with pytest.raises(vx.MeshError, match=f"mesh.inp.*{subject}"):
            read_text(".inp", deck)


def test_sets_of_one_name_in_two_parts_contain_elements_of_their_parts_only(read_text):
    """Define surfaces of two parts by sets of the same name."""
    block = FLAT + "*ELEMENT, TYPE=CPS4\n1, 1, 2, 3, 4\n*ELSET, ELSET=_s, INTERNAL\n1\n*SURFACE, NAME={}\n_s, {}\n"
    parts = "".join(
        f"*PART, NAME={name}\n{block.format(name, side)}*END PART\n" for name, side in (("low", "S1"), ("up", "S3"))
    )
    instances = "*INSTANCE, NAME=a, PART=low\n*END INSTANCE\n*INSTANCE, NAME=b, PART=up\n0., 1.\n*END INSTANCE\n"
    mesh = read_text(".inp", f"{parts}*ASSEMBLY, NAME=A\n{instances}*END ASSEMBLY\n", bodies="physical")
    places = {name: mesh.points[edges][..., 1].ravel().tolist() for name, edges in mesh.boundaries.items()}
    assert (places["a.low"], places["b.up"]) == ([0.0, 0.0], [2.0, 2.0])
    own_mesh = f"*PART, NAME=none\n*END PART\n*INSTANCE, NAME=own, PART=none\n{block.format('a', 'S1')}*END INSTANCE\n"
    assert read_text(".inp", own_mesh).boundaries["a"].tolist() == [[0, 1]]


SOLIDS = {
    "C3D4": ("000 100 010 001", {2: [0, -1, 0], 4: [-1, 0, 0]}),
    "C3D6": ("000 100 010 001 101 011", {2: [0, 0, 1], 3: [0, -1, 0], 5: [-1, 0, 0]}),
    "C3D8": (
        "000 100 110 010 001 101 111 011",
        {2: [0, 0, 1], 3: [0, -1, 0], 4: [1, 0, 0], 5: [0, 1, 0], 6: [-1, 0, 0]},
    ),
}


@pytest.mark.parametrize("kind", SOLIDS)
def test_sides_of_solids_have_the_numbers_of_abaqus(kind, read_text):
    """Name every side of one cell. The sides are all faces of the cell, and S1 is the bottom."""
    places, normals = SOLIDS[kind]
    corners = [", ".join(place) for place in places.split()]
    nodes = "".join(f"{k}, {x}\n" for k, x in enumerate(corners, 1))
    count = {"C3D4": 4, "C3D6": 5, "C3D8": 6}[kind]
    surfaces = "".join(f"*SURFACE, NAME=s{k}\n1, S{k}\n" for k in range(1, count + 1))
    numbers = ", ".join(map(str, range(1, len(corners) + 1)))
    mesh = read_text(".inp", f"*NODE\n{nodes}*ELEMENT, TYPE={kind}\n1, {numbers}\n{surfaces}")
    faces = {k: mesh.boundaries[f"s{k}"] for k in range(1, count + 1)}
    assert sorted(np.concatenate(list(faces.values()))) == list(range(count))
    for k, normal in {1: [0, 0, -1], **normals}.items():
        assert mesh.face_normals[faces[k][0]].round(3).tolist() == normal


# Nastran.


def test_cards_of_nastran_may_have_free_small_and_large_fields(read_text):
    """Read cards without BEGIN BULK and ENDDATA. Numbers after the nodes of a cell are ignored."""
    mesh = read_text(".bdf", BULK)
    assert [cell.tolist() for cell in mesh.cells] == [[0, 1, 2], [0, 2, 3]]
    assert mesh.points.tolist() == SQUARE.tolist()
    assert mesh.cell_data["nastran:ref"].tolist() == [7, 8]
    assert mesh.cell_data["7"].tolist() == [1, 0]
    two = read_text(".bdf", BULK, bodies="physical")
    assert {name: of.bodies for name, of in two.interfaces.items()} == {"7|8": ("7", "8")}


def test_unsupported_cards_are_refused_with_the_cause(read_text):
    for card, subject in (
        ("CBUSH,9,1,1,2", "its card CBUSH 9 is not supported"),
        ("GRID,9,4,1.,0.,0.", "GRID 9 is in the coordinate system 4"),
        ("INCLUDE 'other.bdf'", "its card INCLUDE"),
        ("CTRIA3,9,1,1,2,77", "cannot be read as a mesh .KeyError"),
        ("CTRIA3,9,1,1,2", "its card CTRIA3 9 has fewer than 3 nodes"),
    ):
        with pytest.raises(vx.MeshError, match=f"mesh.bdf.*{subject}"):
            read_text(".bdf", f"{BULK}{card}\n")


# Gmsh.


def test_groups_of_gmsh_become_boundaries_and_cell_data(read_text, capfd):
    """Read curves with and without a name, a curve inside the domain, and a surface in two groups."""
    with pytest.warns(vx.MeshWarning, match="1 of 1 lines named '7' are not on the boundary and are left out"):
        mesh = read_text(".msh", GMSH)
    assert [cell.tolist() for cell in mesh.cells] == [[0, 1, 2], [0, 2, 3]]
    assert mesh.boundaries["floor"].tolist() == [[0, 1]]
    assert mesh.boundaries["9"].tolist() == [[1, 2]]
    assert set(mesh.boundaries) == {"floor", "9", "boundary"}
    assert mesh.cell_data["steel"].tolist() == [1, 0]
    assert mesh.cell_data["all of it"].tolist() == [1, 1]
    assert capfd.readouterr() == ("", "")
    with pytest.raises(vx.MeshError, match="mesh.msh: the name 'boundary' is taken"):
        read_text(".msh", GMSH.replace("floor", "boundary"))
    with pytest.warns(vx.MeshWarning, match="named '7'"):
        reversed_curve = read_text(".msh", GMSH.replace("1 0 0 0 1 0 0 1 1 2 1 -2", "1 0 0 0 1 0 0 1 -1 2 1 -2"))
    assert reversed_curve.boundaries["floor"].tolist() == [[0, 1]]
    with pytest.raises(vx.MeshError, match="its mesh is partitioned, .* unpartition it"):
        read_text(".msh", GMSH.replace("$Nodes", "$PartitionedEntities\n$EndPartitionedEntities\n$Nodes"))


def test_a_cell_in_two_groups_is_one_cell():
    """Read a file of version 2, which repeats cells in several groups. One node belongs to no cell."""
    with pytest.warns(vx.MeshWarning) as caught:
        mesh = read(FILES / "groups_22.msh")
    messages = " ".join(str(one.message) for one in caught)
    assert "1 of 2 polygons named 'floor' are not on the boundary and are left out" in messages
    assert "1 of 6 nodes belong to no cell" in messages
    assert (mesh.face_normals[mesh.boundaries["floor"]] == (0, 0, -1)).all()
    assert set(mesh.boundaries) == {"floor", "5", "boundary"}
    assert mesh.cell_data["steel"].tolist() == [1, 0]
    assert mesh.cell_data["8"].tolist() == [1, 1]
    assert mesh.volumes.tolist() == pytest.approx([1 / 6, 1 / 3])
    with pytest.raises(vx.MeshError, match="'steel' with 1 cells, '8' with 2 cells; 0 .*, 1 in several"):
        read(FILES / "groups_22.msh", bodies="physical")


@pytest.mark.parametrize("version", ["2.2", "4.0", "4.1"])
def test_binary_files_of_gmsh_keep_cell_data(version, tmp_path):
    from meshio.gmsh import main as gmsh

    tags = {name: [np.ones(2, dtype=int)] for name in ("gmsh:physical", "gmsh:geometrical")} | {"a": [np.arange(2.0)]}
    cells = [("triangle", np.array([(0, 1, 2), (0, 2, 3)]))]
    mesh = meshio.Mesh(add_height(SQUARE), cells, cell_data=tags)
    gmsh.write(str(tmp_path / "mesh.msh"), mesh, version, binary=True)
    assert read(tmp_path / "mesh.msh").cell_data["a"].tolist() == [0, 1]


def test_binary_files_of_gmsh_keep_groups_and_curves():
    """Read the binary form of `GMSH`."""
    with pytest.warns(vx.MeshWarning, match="named '7' are not on the boundary"):
        mesh = read(FILES / "groups_41_binary.msh")
    assert mesh.cell_data["steel"].tolist() == [1, 0]
    assert mesh.cell_data["all of it"].tolist() == [1, 1]
    assert set(mesh.boundaries) == {"floor", "9", "boundary"}


# VTK.


def write(path, points, cells, **data):
    """Write a file with meshio."""
    meshio.Mesh(points, cells, **data).write(path, **({"file_format": "gmsh22"} if path.suffix == ".msh" else {}))


def add_height(points, z=0.0):
    return np.pad(np.asarray(points, dtype=float), ((0, 0), (0, 1)), constant_values=z)


def test_a_constant_z_is_dropped_and_cells_keep_their_order(tmp_path):
    points = [*SQUARE, (2.0, 0.0), (2.0, 1.0), (0.5, 1.5)]
    cells = [("triangle", [[1, 4, 5]]), ("polygon", [[0, 1, 2, 6, 3]]), ("triangle", [[1, 5, 2]])]
    write(tmp_path / "mesh.vtu", add_height(points, 7.5), cells)
    mesh = read(tmp_path / "mesh.vtu")
    np.testing.assert_array_equal(mesh.points, points)
    assert [cell.tolist() for cell in mesh.cells] == [[1, 4, 5], [0, 1, 2, 6, 3], [1, 5, 2]]


def test_files_without_a_valid_mesh_are_refused_with_the_cause(tmp_path):
    for points, (kind, corners), subject in (
        (np.column_stack([SQUARE, [0, 0, 0, 1]]), ("quad", [[0, 1, 2, 3]]), "z = constant: z runs from 0 to 1"),
        (add_height(SQUARE), ("VTK_LAGRANGE_CURVE", [[0, 1, 2]]), "cells of the kind 'number 68 of VTK'"),
        (add_height(SQUARE), ("line", [[0, 1]]), "it has no polygons, only line"),
        (add_height(SQUARE), ("quad", [[0, 1, 2, 9]]), "mesh.vtu: cell 0 names node 9"),
        (add_height([*SQUARE[:3], (np.nan, 1)]), ("quad", [[0, 1, 2, 3]]), r"mesh.vtu: node 3 is at \(nan, 1.0\)"),
    ):
        write(tmp_path / "mesh.vtu", points, [(kind, np.array(corners))])
        with pytest.raises(vx.MeshError, match=subject):
            read(tmp_path / "mesh.vtu")


def test_warnings_about_corrections_begin_with_the_path(tmp_path):
    write(tmp_path / "mesh.vtu", add_height([*SQUARE, (5, 5)]), [("quad", np.array([[3, 2, 1, 0]]))])
    with pytest.warns(vx.MeshWarning) as caught:
        mesh = read(tmp_path / "mesh.vtu")
    messages = [str(warning.message) for warning in caught]
    assert all(message.startswith(f"{tmp_path / 'mesh.vtu'}: ") for message in messages)
    found = ("clockwise", "dropped", "by position, sides are named left, right, bottom, top.")
    assert all(words in message for words, message in zip(found, messages, strict=True))
    assert caught[0].filename == __file__
    assert mesh.node_map.tolist() == [0, 1, 2, 3, -1]


@pytest.mark.parametrize("options", [{"binary": False}, *({"compression": one} for one in ("zlib", "lzma", None))])
def test_vtu_files_of_meshio_may_be_text_binary_or_compressed(options, tmp_path):
    mesh = vx.meshes.hexagons(3)
    mesh = mesh.with_cell_data("a", np.arange(mesh.n_cells))
    mesh.to("meshio").write(tmp_path / "mesh.vtu", **options)
    back = read(tmp_path / "mesh.vtu")
    np.testing.assert_array_equal(back.vertices, mesh.vertices)
    np.testing.assert_array_equal(back.cell_data["a"], mesh.cell_data["a"])


def test_polyhedra_in_the_layout_of_vtk_9_4_are_read(read_text):
    """Read a polyhedron, a hexahedron and a marked square. Damaged lists are refused."""
    mesh = read_text(".vtu", POLYHEDRA)
    np.testing.assert_allclose(mesh.volumes, [1.0, 2.0])
    assert mesh.cell_data["young"].tolist() == [1.0, 2.0]
    assert (mesh.face_normals[mesh.boundaries["floor"]] == [(0, 0, -1)]).all()
    for wrong, message in (
        (POLYHEDRA.replace("42 12 9<", "42 12 5<"), "its cells of the kind 'triangle' have a wrong number of nodes"),
        (POLYHEDRA.replace("4 8 12 16 20 24", "4 8 12 16 20 500000000"), "its lists of faces are damaged"),
        (POLYHEDRA.replace(">8 16 20<", ">8 500000000 20<"), "its lists of cells are damaged"),
        (POLYHEDRA.replace("</Piece>", "</Piece><Piece/>"), "it has 2 pieces of an UnstructuredGrid instead of one"),
        (POLYHEDRA.replace("3 1 1\n", "3 1 1.1\n"), "its face .* is not plane: .* Split the face into triangles"),
    ):
        assert wrong != POLYHEDRA
        with pytest.raises(vx.MeshError, match=f"mesh.vtu.*{message}"):
            read_text(".vtu", wrong)


# Cells of higher order.


def add_nodes(cells, nodes):
    """Return cells with new nodes after their corners."""
    more = np.arange(cells.max() + 1, cells.max() + 1 + len(cells) * (nodes - cells.shape[1]))
    return np.hstack([cells, more.reshape(len(cells), -1)])


HIGHER = [("triangles", 6), ("squares", 8), ("squares", 9), ("tetrahedra", 10), ("cubes", 20), ("cubes", 27)]


@pytest.mark.parametrize("suffix", [".vtu", ".msh"])
@pytest.mark.parametrize(("family", "nodes"), HIGHER)
def test_cells_of_higher_order_are_read_by_their_corners(family, nodes, suffix, tmp_path):
    first = getattr(vx.meshes, family)(2)
    block = first.to("meshio").cells[0]
    cells = add_nodes(np.asarray(block.data), nodes)
    kind, path = f"{block.type}{nodes}", tmp_path / f"curved{suffix}"
    points = np.pad(first.to("meshio").points, ((0, cells.max() + 1 - first.n_nodes), (0, 0)), constant_values=0.3)
    write(path, points, [(kind, cells)])
    with pytest.warns(vx.MeshWarning) as caught:
        mesh = read(path)
    messages = " ".join(str(one.message) for one in caught)
    assert f"{path}: cells of higher order ({kind}) are read as their corners, with straight edges." in messages
    assert f"{len(points) - first.n_nodes} of {len(points)} nodes belong to no cell" in messages
    np.testing.assert_array_equal(mesh.points, first.points)
    np.testing.assert_allclose(mesh.measures, first.measures, rtol=1e-13)


# Damaged files.


MADE = {".vtu": small("voronoi", 2), ".kelvin.vtu": vx.meshes.kelvin(1)}
TEXTS = {".polyhedra.vtu": POLYHEDRA, ".parts.inp": TWICE, ".deck.inp": DECK, ".bdf": BULK}
TEXTS |= {".msh": GMSH, ".solid.msh": (FILES / "groups_22.msh").read_text()}


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [*MADE, *TEXTS])
def test_damaged_files_are_refused_or_hold_a_mesh(suffix, tmp_path):
    """Read 250 damaged files within limits of time and memory. Errors contain the path of the file."""
    whole, rng = tmp_path / f"whole{suffix}", np.random.default_rng(1)
    if suffix in MADE:
        MADE[suffix].write(whole)
    else:
        whole.write_text(TEXTS[suffix])
    paths, data = [tmp_path / f"broken{k}{suffix}" for k in range(250)], whole.read_bytes()
    for path in paths:
        path.write_bytes(mutated(data, rng))
    for start in range(0, len(paths), 50):
        read_all(paths[start : start + 50])


@pytest.mark.parametrize("suffix", [".vtu", ".msh", ".inp", ".bdf"])
def test_files_without_a_mesh_are_refused(suffix, tmp_path, capfd):
    for data in (b"", b"\n" * 1000, bytes(5000), b"<" * 100_000, b"9" * 4000, b"Dear colleague,\n"):
        (tmp_path / f"nothing{suffix}").write_bytes(data)
        with pytest.raises(vx.MeshError, match="nothing"):
            read(tmp_path / f"nothing{suffix}")
    assert capfd.readouterr() == ("", "")
