"""Gmsh files with several physical groups of cells: each group becomes a body."""

import meshio
import numpy as np
import pytest

import vemcvx as vx


def write(path, points, blocks, tags, groups):
    """Write a Gmsh file. `tags` has the group of every cell. `groups` maps names to numbers and dimensions."""
    mesh = meshio.Mesh(
        np.pad(points, ((0, 0), (0, 3 - np.shape(points)[1]))),
        blocks,
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={name: np.array(value) for name, value in groups.items()},
    )
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    return path


BOTH = {"plate": [11, 2], "pin": [12, 2]}


def write_two_squares(path, outside=False, names=True):
    """Write two unit squares, "plate" and "pin", with common nodes. `outside` removes a cell from the groups."""
    made = vx.meshes.triangles(4, box=((0.0, 2.0), (0.0, 1.0)))
    right = made.centroids[:, 0] > 1
    wall, rim = made.boundaries["left"], made.boundaries["right"]
    tags = [np.repeat([1, 2], [len(wall), len(rim)]), np.where(right, 12, 11)]
    if outside:
        tags[1][0] = 0
    groups = {"wall": [1, 1], "rim": [2, 1], **BOTH} if names else {}
    return write(
        path, made.points, [("line", np.vstack([wall, rim])), ("triangle", np.array(made.cells))], tags, groups
    )


def test_groups_become_bodies(tmp_path):
    mesh = vx.meshes.read(write_two_squares(tmp_path / "two.msh"), bodies="physical")
    assert sorted(mesh.boundaries) == ["boundary", "pin.rim", "plate.wall", "plate|pin"]
    assert list(mesh.interfaces) == ["plate|pin"]
    assert sorted(mesh.cell_data) == ["body", "pin", "plate"]
    assert (mesh.n_cells, mesh.n_nodes) == (64, 50)


def test_an_arc_named_on_one_body_names_the_interface(tmp_path):
    """Read a disc and a plate with different edges. tolerance= must exceed the distance between the polygons."""
    hole, disc = vx.meshes.ring((1.0, 2.0), 12), vx.meshes.ring((0.3, 1.0), 16)
    points = np.concatenate([hole.points, disc.points])
    inner = hole.boundaries["boundary"]
    inner = inner[np.linalg.norm(hole.points[inner], axis=2).max(axis=1) < 1.5]
    cells = np.concatenate([np.array(hole.cells), np.array(disc.cells) + hole.n_nodes])
    tags = [np.full(len(inner), 3), np.repeat([11, 12], [hole.n_cells, disc.n_cells])]
    write(tmp_path / "two.msh", points, [("line", inner), ("quad", cells)], tags, {**BOTH, "bore": [3, 1]})
    with pytest.raises(vx.MeshError, match="tolerance="):
        vx.meshes.read(tmp_path / "two.msh", bodies="physical")
    found = vx.meshes.read(tmp_path / "two.msh", bodies="physical", tolerance=0.05)
    assert list(found.interfaces) == ["bore"]
    assert len(found.interfaces["bore"].edges) > 16
    with pytest.raises(vx.MeshError, match="read: found bodies = None; give bodies='physical' .tolerance= needs it"):
        vx.meshes.read(tmp_path / "two.msh", tolerance=0.05)


def test_groups_without_names_become_bodies_and_cells_in_no_group_are_refused(tmp_path):
    mesh = vx.meshes.read(write_two_squares(tmp_path / "two.msh", names=False), bodies="physical")
    assert list(mesh.interfaces) == ["11|12"]
    assert {"11.1", "12.2"} < set(mesh.boundaries)
    vx.meshes.squares(2).write(tmp_path / "one.vtu")
    for path, how, subject in (
        (write_two_squares(tmp_path / "two.msh", outside=True), "physical", "1 cells are in no body, 0 in several"),
        (tmp_path / "one.vtu", "physical", "bodies='physical' is for files of Gmsh, Abaqus and Nastran"),
        (tmp_path / "one.vtu", "all", "read: found bodies = 'all'; give bodies='physical'"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            vx.meshes.read(path, bodies=how)


def test_a_named_face_between_two_volumes_is_their_interface(tmp_path):
    """Two blocks in a row have lengths l1, l2 and moduli E1, E2. The pressure p moves the end by -p (l1/E1 + l2/E2)."""
    x = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    x += [(3, 0, 0), (3, 1, 0), (3, 0, 1), (3, 1, 1)]
    sides = [[0, 3, 7, 4], [1, 2, 6, 5], [8, 9, 11, 10]]
    cells = [[0, 1, 2, 3, 4, 5, 6, 7], [1, 8, 9, 2, 5, 10, 11, 6]]
    tags, groups = [np.array([1, 2, 3]), np.array([11, 12])], {"wall": [1, 2], "joint": [2, 2], "end": [3, 2]}
    groups |= {"lug": [11, 3], "pin": [12, 3]}
    path = write(tmp_path / "two.msh", x, [("quad", sides), ("hexahedron", cells)], tags, groups)
    mesh = vx.meshes.read(path, bodies="physical")
    assert (mesh.n_cells, mesh.n_nodes) == (2, 16)
    assert mesh.measures.tolist() == [1.0, 2.0]
    assert mesh.interfaces["joint"].bodies == ("lug", "pin")
    assert set(mesh.boundaries) == {"lug.wall", "pin.end", "joint", "boundary"}
    scene = vx.Scene(
        vx.Elasticity(10.0, 0.0, on="lug"),
        vx.Elasticity(20.0, 0.0, on="pin"),
        vx.Clamp(on="lug.wall"),
        vx.Traction((-0.1, 0.0, 0.0), on="pin.end"),
        vx.UnilateralContact(on="joint"),
        vx.TrescaFriction(1.0, on="joint"),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    assert history.contact.pressure[-1] == pytest.approx(0.1, rel=1e-9)
    assert history.displacement[-1, mesh.points[:, 0] == 3, 0] == pytest.approx(-0.1 * (1 / 10 + 2 / 20), rel=1e-9)


@pytest.mark.parametrize("fraction", [0.5, 1.0])
def test_lines_between_bodies_name_the_interface_or_a_part_of_it(tmp_path, fraction):
    """Name half of the edges between two bodies, or all of them."""
    made = vx.meshes.squares((4, 2), box=((0.0, 2.0), (0.0, 1.0)))
    cells = np.array(made.cells)
    right = made.centroids[:, 0] > 1
    middle = np.flatnonzero(np.abs(made.points[:, 0] - 1) < 1e-12)
    lines = np.column_stack([middle[:-1], middle[1:]])[: round(2 * fraction)]
    tags = [np.full(len(lines), 1), np.where(right, 12, 11)]
    path = tmp_path / "two.msh"
    write(path, made.points, [("line", lines), ("quad", cells)], tags, {"joint": [1, 1], **BOTH})
    found = vx.meshes.read(path, bodies="physical")
    assert list(found.interfaces) == ["joint" if fraction == 1.0 else "plate|pin"]
    assert sorted(found.boundaries) == ["boundary", "joint", *["plate|pin"] * (fraction < 1.0)]
    assert len(found.boundaries["joint"]) == 2 * fraction
    assert found.points[found.boundaries["joint"]][..., 1].max() == fraction
