"""Meshes in space in files and in other libraries: what comes back, from ours and from theirs, and what is refused."""

from __future__ import annotations

import re
import warnings

import meshio
import numpy as np
import polydata
import pytest
from refined_cubes import refined_cubes

import vemcvx as vx
from vemcvx.meshes.io.vtk import packed_cells, write_cells

BOX = ((0.1, 1.1), (2.0, 4.0), (-5.0, -4.0))
CUBE = [(x, y, z) for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)]
HEXAHEDRON = [[0, 1, 3, 2, 4, 5, 7, 6]]


def made(name):
    if name == "refined":
        mesh = refined_cubes(2, (0, 3), 0.3)
    elif name == "nonconvex":
        mesh = vx.meshes.nonconvex(3, seed=1).extruded([0.0, 0.3, 1.0])
    else:
        mesh = vx.meshes.SPACE_FAMILIES[name](2, BOX, 1)
    rng = np.random.default_rng(0)
    mesh = mesh.with_cell_data("young", rng.random(mesh.n_cells)).with_cell_data("axis", rng.random((mesh.n_cells, 3)))
    mesh = mesh.with_cell_data("soil", np.arange(mesh.n_cells) % 2 == 0).with_cell_data("k", np.arange(mesh.n_cells))
    return mesh.with_boundary("half", lambda x: x[:, 1] < np.median(x[:, 1]))


@pytest.fixture(params=[*vx.meshes.SPACE_FAMILIES, "refined", "nonconvex"])
def mesh(request):
    return made(request.param)


@pytest.fixture(params=["cubes", "tetrahedra", "wedges", "pyramids", "mixed"])
def standard(request):
    """Meshes of the four shapes that have vertices in a usual order."""
    if request.param == "wedges":
        return vx.meshes.triangles(2).extruded([0.0, 0.5, 1.0])
    if request.param == "pyramids":
        return pyramids().with_boundary("floor", lambda x: x[:, 2] < 0.1)
    if request.param == "mixed":
        return vx.meshes.convert(mixed())
    return vx.meshes.SPACE_FAMILIES[request.param](2, BOX)


def pyramids():
    points = [*CUBE, (0.5, 0.4, 0.6)]
    faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    cells = [[face, *([face[k], face[k - 1], 8] for k in range(4))] for face in faces]
    return vx.PolyhedralMesh(points, cells)


def mixed():
    """A hexahedron, on it a pyramid, beside it a wedge, and on that a tetrahedron."""
    points = [*CUBE, (0.5, 0.5, 2.0), (2.0, 0.5, 0.0), (2.0, 0.5, 1.0), (1.5, 0.5, 2.0)]
    blocks = [
        ("wedge", [[1, 9, 3, 5, 10, 7]]),
        ("hexahedron", HEXAHEDRON),
        ("tetra", [[5, 10, 7, 11]]),
        ("pyramid", [[4, 5, 7, 6, 8]]),
    ]
    return meshio.Mesh(
        points, blocks, cell_data={"young": [[3.0], [1.0], [4.0], [2.0]]}, cell_sets={"soft": [[0], [], [0], None]}
    )


def same(one, other):
    """Whether everything is the same to the bit."""
    np.testing.assert_array_equal(one.points, other.points)
    for mine, yours in zip(one.faces, other.faces, strict=True):
        np.testing.assert_array_equal(mine, yours)
    assert {n: f.tolist() for n, f in one.boundaries.items()} == {n: f.tolist() for n, f in other.boundaries.items()}
    assert set(one.cell_data) == set(other.cell_data)
    for name, values in one.cell_data.items():
        np.testing.assert_array_equal(values, other.cell_data[name])


def test_vtu_to_the_bit(mesh, tmp_path):
    path = tmp_path / "mesh.vtu"
    mesh = mesh.with_boundary('a & "<b>" é', lambda x: x[:, 0] > np.median(x[:, 0]))
    mesh.write(path)
    back = vx.meshes.read(path)
    assert type(back) is vx.PolyhedralMesh
    same(mesh, back)


def test_pickled(mesh):
    import pickle

    back = pickle.loads(pickle.dumps(mesh))
    same(mesh, back)
    assert not back.cell_data["young"].flags.writeable
    assert repr(back) == repr(mesh)
    assert "young" in mesh._repr_html_()
    assert re.search("&quot;half&quot;.*faces", mesh._repr_html_())


def test_opened_by_pyvista(mesh, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    path = tmp_path / "mesh.vtu"
    mesh.write(path)
    grid = pyvista.read(path)
    solid = grid.celltypes == 42
    assert solid.sum() == mesh.n_cells
    np.testing.assert_array_equal(grid.points, mesh.points)
    np.testing.assert_array_equal(grid.cell_data["young"][solid], mesh.cell_data["young"])
    marked = grid.cell_data["boundary:half"]
    assert marked.sum() == len(mesh.boundaries["half"])
    if (np.diff(mesh.face_offsets) > 8).any():
        return  # VTK's areas and volumes are those of faces and cells without dents
    area = grid.extract_cells(np.flatnonzero(marked)).compute_cell_sizes()["Area"].sum()
    assert area == pytest.approx(mesh.face_areas[mesh.boundaries["half"]].sum(), rel=1e-12)
    np.testing.assert_allclose(grid.compute_cell_sizes()["Volume"][solid], mesh.volumes, rtol=1e-12)


@pytest.mark.parametrize("binary", [True, False])
def test_written_by_pyvista(mesh, tmp_path, binary):
    """Its files have the newest layout of faces, compressed and as text."""
    pytest.importorskip("pyvista")
    path = tmp_path / "theirs.vtu"
    mesh.to("pyvista").save(path, binary=binary)
    back = vx.meshes.read(path)
    same(mesh, back) if binary else [
        np.testing.assert_array_equal(*pair) for pair in zip(mesh.faces, back.faces, strict=True)
    ]


def test_to_pyvista_and_back(mesh):
    pytest.importorskip("pyvista")
    same(mesh, vx.meshes.convert(mesh.to("pyvista")))


def test_standard_shapes_in_pyvista(standard):
    pyvista = pytest.importorskip("pyvista")
    grid = pyvista.from_meshio(standard.to("meshio"))
    back = vx.meshes.convert(grid)
    np.testing.assert_allclose(back.volumes, standard.volumes, rtol=1e-13)


def equal_cells(one, other):
    """Whether cells have the same nodes in the same order of cells; how faces are numbered may differ."""
    np.testing.assert_array_equal(one.points, other.points)
    for mine, yours in zip(one.cell_nodes, other.cell_nodes, strict=True):
        np.testing.assert_array_equal(mine, yours)
    np.testing.assert_allclose(one.volumes, other.volumes, rtol=1e-13)


def places(mesh, name):
    faces = mesh.boundaries[name]
    return sorted(map(tuple, mesh.face_centroids[faces].round(12).tolist()))


@pytest.mark.parametrize("suffix", [".msh", ".vtk", ".inp", ".bdf"])
def test_other_formats(standard, suffix, tmp_path):
    path = tmp_path / f"mesh{suffix}"
    standard = standard.with_boundary("lid", lambda x: x[:, 2] == x[:, 2].max())
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*files do not keep")
        if suffix == ".inp" and 5 in np.diff(standard.cell_nodes[0]):  # meshio knows no pyramids of Abaqus
            with pytest.raises(vx.MeshError, match="cannot be written"):
                standard.write(path)
            return
        standard.write(path)
        warnings.filterwarnings("ignore", message=".*no part of the boundary has a name")
        back = vx.meshes.read(path)
    for mine, yours in zip(standard.cell_nodes, back.cell_nodes, strict=True):
        np.testing.assert_array_equal(mine, yours)
    if suffix in (".msh", ".vtk"):
        equal_cells(standard, back)
        assert places(back, "lid") == places(standard, "lid")


def test_gmsh_keeps_physical_groups(tmp_path):
    path = tmp_path / "mesh.msh"
    mesh = vx.meshes.tetrahedra(2, BOX)
    mesh.write(path)
    back = vx.meshes.read(path)
    assert list(back.boundaries) == list(mesh.boundaries)
    for name in mesh.boundaries:
        assert places(back, name) == places(mesh, name)


def test_physical_groups_of_gmsh(tmp_path):
    """As Gmsh writes them: surfaces with names and without, volumes with names."""
    path = tmp_path / "gmsh.msh"
    path.write_text(
        """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
2 1 "floor"
3 7 "steel"
$EndPhysicalNames
$Nodes
5
1 0 0 0
2 1 0 0
3 0 1 0
4 0 0 1
5 1 1 1
$EndNodes
$Elements
5
1 2 2 1 1 1 3 2
2 2 2 5 2 1 2 4
3 2 2 1 1 2 3 4
4 4 2 7 1 1 2 3 4
5 4 2 0 1 5 2 3 4
$EndElements
"""
    )
    with pytest.warns(vx.MeshWarning, match="1 of 2 polygons named 'floor' are not on the boundary and are left out"):
        mesh = vx.meshes.read(path)
    assert list(mesh.boundaries) == ["floor", "5", "boundary"]
    assert (mesh.face_normals[mesh.boundaries["floor"]] == (0, 0, -1)).all()
    assert mesh.cell_data["steel"].tolist() == [1, 0]
    assert mesh.volumes.tolist() == pytest.approx([1 / 6, 1 / 3])


def test_meshes_of_meshio(standard):
    back = vx.meshes.convert(standard.to("meshio"))
    equal_cells(standard, back)
    assert list(back.boundaries) == list(standard.boundaries)
    for name in standard.boundaries:
        assert places(back, name) == places(standard, name)
    assert set(back.cell_data) == set(standard.cell_data)


def test_kinds_mixed_and_numbered_either_way():
    """Nodes of wedges run both ways around in other programs: no warning."""
    with pytest.warns(vx.MeshWarning, match="by their place, sides are called left, front, back, bottom"):
        mesh = vx.meshes.convert(mixed())
    np.testing.assert_allclose(mesh.volumes, [0.5, 1.0, 1 / 6, 1 / 3])
    assert mesh.cell_data["young"].tolist() == [3, 1, 4, 2]
    assert mesh.cell_data["soft"].tolist() == [1, 0, 1, 0]
    mirrored = mixed()
    mirrored.points = mirrored.points * [-1.0, 1.0, 1.0]
    with pytest.warns(vx.MeshWarning, match="by their place"):
        np.testing.assert_allclose(vx.meshes.convert(mirrored).volumes, mesh.volumes)


def test_sides_without_names(tmp_path):
    path = tmp_path / "mesh.vtu"
    meshio.Mesh(CUBE, [("hexahedron", HEXAHEDRON)]).write(path)
    sides = "left, right, front, back, bottom, top"
    with pytest.warns(
        vx.MeshWarning, match=f"no part of the boundary has a name; by their place, sides are called {sides}"
    ):
        mesh = vx.meshes.read(path)
    assert list(mesh.boundaries) == [*sides.split(", "), "boundary"]


@pytest.mark.parametrize("name", ["cubes", "tetrahedra"])
def test_meshes_of_scikit_fem(name):
    mesh = made(name)
    with pytest.warns(vx.MeshWarning, match="keep only sets of cells .0 or 1., not 'axis', 'k', 'young'"):
        theirs = mesh.to("skfem")
    assert type(theirs).__name__ == {"cubes": "MeshHex1", "tetrahedra": "MeshTet1"}[name]
    back = vx.meshes.convert(theirs)
    equal_cells(mesh, back)
    for side in mesh.boundaries:
        assert places(back, side) == places(mesh, side)
    assert back.cell_data["soil"].tolist() == mesh.cell_data["soil"].tolist()


def test_scikit_fem_has_its_volumes():
    """Its own integral over the mesh: hexahedra come with their vertices where it has them."""
    import skfem

    for make, element in ((vx.meshes.cubes, skfem.ElementHex1()), (vx.meshes.tetrahedra, skfem.ElementTetP1())):
        basis = skfem.Basis(make(2, BOX).to("skfem"), element)
        assert (basis.dx > 0.0).all()
        assert basis.dx.sum() == pytest.approx(2.0, rel=1e-13)


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda mesh: mesh.to("skfem"), "tetrahedra, hexahedra, wedges and pyramids alone .*cell 0 is none of them"),
        (lambda mesh: mesh.to("meshio"), "Polyhedra go into .vtu files and to PyVista"),
        (lambda mesh: mesh.to("vtk"), "a mesh goes to 'meshio', 'skfem', 'pyvista'"),
    ],
)
def test_what_others_do_not_have(write, message):
    with pytest.raises(vx.MeshError, match=message):
        write(vx.meshes.kelvin(1))


def test_formats_without_polyhedra(tmp_path):
    with pytest.raises(vx.MeshError, match=r"mesh.msh: tetrahedra, .* Polyhedra go into .vtu"):
        vx.meshes.voronoi3(2).write(tmp_path / "mesh.msh")
    assert not list(tmp_path.iterdir())
    with pytest.raises(vx.MeshError, match="scikit-fem has meshes of tetrahedra or of hexahedra"):
        pyramids().to("skfem")


def test_warped_hexahedra_are_refused(tmp_path):
    points = np.array(CUBE)
    points[7] += 0.1
    path = tmp_path / "warped.vtu"
    meshio.Mesh(points, [("hexahedron", HEXAHEDRON)]).write(path)
    with pytest.raises(
        vx.MeshError, match=r"warped.vtu: cell 0: its face .* is not plane: .* Split the face into triangles"
    ):
        vx.meshes.read(path)


def test_unused_nodes_of_files():
    quad = [[0, 1, 3, 2]]
    mesh = meshio.Mesh(
        [(9, 9, 9), *CUBE],
        [("hexahedron", np.array(HEXAHEDRON) + 1), ("quad", np.array(quad) + 1)],
        cell_sets={"floor": [[], [0]]},
    )
    with pytest.warns(vx.MeshWarning, match="1 of 9 nodes belong to no cell"):
        back = vx.meshes.convert(mesh)
    assert (back.face_normals[back.boundaries["floor"]] == (0, 0, -1)).all()


def test_fields_on_cells_and_nodes(mesh, tmp_path):
    path = tmp_path / "fields.vtu"
    moved = mesh.points @ np.diag([0.1, 0.0, -0.2])
    write_cells(
        path,
        packed_cells(mesh),
        {"displacement": moved, "p": moved[:, 0]},
        {"stress": np.arange(6.0 * mesh.n_cells).reshape(-1, 6)},
    )
    pyvista = pytest.importorskip("pyvista")
    grid = pyvista.read(path)
    np.testing.assert_array_equal(grid.point_data["displacement"], moved)
    np.testing.assert_array_equal(grid.point_data["p"], moved[:, 0])
    assert grid.cell_data["stress"].shape == (mesh.n_cells, 6)
    with pytest.raises(vx.MeshError, match=f"point field 'p' needs {mesh.n_nodes} rows"):
        write_cells(path, packed_cells(mesh), {"p": [1.0]}, {})


def test_the_newest_layout_of_faces(tmp_path):
    """As ParaView and PyVista write polyhedra since VTK 9.4; beside one, a hexahedron and a marked square."""
    path = tmp_path / "theirs.vtu"
    path.write_text(polydata.POLYHEDRA)
    mesh = vx.meshes.read(path)
    np.testing.assert_allclose(mesh.volumes, [1.0, 2.0])
    assert mesh.cell_data["young"].tolist() == [1.0, 2.0]
    assert (mesh.face_normals[mesh.boundaries["floor"]] == [(0, 0, -1)]).all()


DAMAGES = [
    ("faces", lambda a: a[:-1], "damaged"),
    ("faces", lambda a: np.r_[10**9, a[1:]], "damaged"),
    ("faces", lambda a: np.r_[-1, a[1:]], "damaged"),
    ("faces", lambda a: np.r_[a[0], 10**15, a[2:]], "damaged"),
    ("faces", lambda a: np.r_[a[0], -4, a[2:]], "damaged"),
    ("faces", lambda a: np.r_[a[0], a[1], 999, a[3:]], "names node 999"),
    ("faces", lambda a: a.astype(float), "no whole numbers"),
    ("faceoffsets", lambda a: a[:-1], "damaged"),
    ("faceoffsets", lambda a: a[::-1], "damaged"),
    ("faceoffsets", lambda a: a + 10**12, "damaged"),
    ("faceoffsets", lambda a: a * 0, "damaged"),
    ("offsets", lambda a: a[::-1], "damaged|cannot be read"),
    ("offsets", lambda a: a + 10**12, "damaged"),
    ("types", lambda a: np.r_[a[:-1], np.uint8(99)], "number 99 of VTK"),
    ("types", lambda a: a[:-1], "damaged|cannot be read"),
]


@pytest.mark.parametrize(("name", "damage", "message"), DAMAGES, ids=[f"{k}-{d[0]}" for k, d in enumerate(DAMAGES)])
def test_damaged_faces(name, damage, message, tmp_path, monkeypatch):
    from vemcvx.meshes.io import vtk

    arrays = vtk._cells

    def damaged(grid):
        found = dict(arrays(grid))
        return found | {name: damage(found[name])}

    monkeypatch.setattr(vtk, "_cells", damaged)
    path = tmp_path / "damaged.vtu"
    write_cells(path, packed_cells(vx.meshes.cubes(2)), {}, {})
    with pytest.raises(vx.MeshError, match=rf"damaged.vtu.*({message})"):
        vx.meshes.read(path)
