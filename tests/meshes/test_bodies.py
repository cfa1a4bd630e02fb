"""Several bodies in one mesh: interfaces, what becomes of names and data, and what is refused."""

from __future__ import annotations

import itertools
import pickle

import meshio
import numpy as np
import pytest

import vemcvx as vx
from vemcvx.meshes import FAMILIES, PolygonMesh, bodies, squares

EPS = np.finfo(float).eps


def lengths(mesh, edges):
    return np.hypot(*(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]]).T)


def assert_matched(mesh):
    """Both sides of each interface are edges of the boundary in the same places, to the bit; the whole is a mesh."""
    all_edges = set(map(tuple, mesh.boundaries["boundary"].tolist()))
    for name, found in mesh.interfaces.items():
        np.testing.assert_array_equal(mesh.points[found.edges], mesh.points[found.partners])
        assert set(map(tuple, found.edges.tolist())) <= all_edges
        assert set(map(tuple, found.partners[:, ::-1].tolist())) <= all_edges
        np.testing.assert_array_equal(mesh.boundaries[name], found.edges)
        for side, body in zip((found.edges, found.partners), found.bodies, strict=True):
            inside = np.isin(
                np.arange(mesh.n_nodes), mesh.vertices[np.repeat(mesh.cell_data[body] == 1, np.diff(mesh.offsets))]
            )
            assert inside[side].all()
    again = PolygonMesh(mesh.points, mesh.cells, interfaces=mesh.interfaces)
    assert len(again.boundaries["boundary"]) == len(mesh.boundaries["boundary"])


@pytest.mark.parametrize(("below", "above"), list(itertools.product(FAMILIES, FAMILIES)))
@pytest.mark.parametrize("counts", [(7, 5), (1, 13)])
def test_blocks_of_every_family_match(below, above, counts):
    n, m = counts
    lower = FAMILIES[below]((n, max(1, n // 2)), ((0, 1), (0, 0.5)), seed=1)
    upper = FAMILIES[above]((m, max(1, m // 2)), ((0, 1), (0.5, 1.1)), seed=2)
    mesh = bodies({"lower": lower, "upper": upper})
    assert_matched(mesh)
    found = mesh.interfaces["lower|upper"]
    assert found.bodies == ("lower", "upper")
    along = {
        x for body, name in ((lower, "top"), (upper, "bottom")) for x in body.points[body.boundaries[name], 0].ravel()
    }
    assert set(mesh.points[found.edges, 0].ravel()) == along
    assert lengths(mesh, found.edges).sum() == pytest.approx(1.0, abs=len(along) * EPS)
    # Hanging vertices on straight sides move nothing, and areas are sums over as many vertices.
    np.testing.assert_allclose(mesh.areas, np.concatenate([lower.areas, upper.areas]), rtol=1e-13)
    assert set(mesh.boundaries) == {
        *(f"lower.{name}" for name in ("left", "right", "bottom")),
        *(f"upper.{name}" for name in ("left", "right", "top")),
        *("lower|upper", "boundary"),
    }


def test_materials_of_bodies_are_named_by_the_bodies():
    mesh = bodies({"lower": squares(2), "upper": squares(3, ((0, 1), (1, 2)))})
    np.testing.assert_array_equal(mesh.cell_data["body"], [0] * 4 + [1] * 9)
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3, on="lower"),
        vx.Elasticity(1.0, 0.3, on="upper"),
        vx.Clamp(on=["lower.bottom", "upper.top"]),
        vx.Traction(lambda x, t: np.full((len(x), 2), t), on="upper.right"),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    np.testing.assert_array_equal(history.displacement[-1][mesh.points[:, 1] < 1.0], 0.0)


@pytest.mark.parametrize("balance", [True, False])
@pytest.mark.parametrize(
    ("below", "above"), [("voronoi", "squares"), ("nonconvex", "triangles"), ("hanging", "hexagons")]
)
def test_refinement_keeps_interfaces_matched(below, above, balance):
    blocks = {
        "lower": FAMILIES[below]((4, 2), ((0, 1), (0, 0.5)), seed=1),
        "upper": FAMILIES[above]((3, 3), ((0.25, 1.1), (0.5, 1.1)), seed=2),
        "beside": FAMILIES[above]((2, 3), ((1, 1.3), (0.1, 0.5)), seed=2),
    }
    mesh, random = bodies(blocks), np.random.default_rng(3)
    for _ in range(4):
        before = mesh
        mesh = mesh.refine(random.random(mesh.n_cells) < 0.4, balance=balance)
        assert_matched(mesh)
        assert list(mesh.boundaries) == list(before.boundaries)
        for name, edges in before.boundaries.items():
            new = mesh.boundaries[name]
            assert lengths(mesh, new).sum() == pytest.approx(lengths(before, edges).sum(), abs=len(new) * EPS)
    assert len(mesh.interfaces["lower|upper"].edges) > len(bodies(blocks).interfaces["lower|upper"].edges)


def three_blocks():
    """A row of three whose faces overlap in part, with names that are hard to spell."""
    return bodies(
        {
            "größe <&:/>": FAMILIES["voronoi"](3, ((0, 1), (0, 1)), seed=1).with_cell_data("E", np.arange(9.0)),
            "middle": FAMILIES["hexagons"](4, ((1, 2), (0.25, 1.5))),
            "right": FAMILIES["triangles"](3, ((2, 3), (-1, 1))),
        },
        interfaces={"joint: a|b": ("right", "middle")},
    )


def assert_same(one, other):
    for name in ("points", "offsets", "vertices"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for kind in ("boundaries", "cell_data"):
        assert set(getattr(one, kind)) == set(getattr(other, kind))
        for name, values in getattr(one, kind).items():
            np.testing.assert_array_equal(values, getattr(other, kind)[name])
    assert {k: i.bodies for k, i in one.interfaces.items()} == {k: i.bodies for k, i in other.interfaces.items()}
    for name, found in one.interfaces.items():
        np.testing.assert_array_equal(found.partners, other.interfaces[name].partners)
        np.testing.assert_array_equal(found.edges, other.interfaces[name].edges)


@pytest.mark.parametrize("suffix", [".vtu", ".vtk"])
def test_files_keep_interfaces(suffix, tmp_path):
    mesh = three_blocks()
    assert {name: found.bodies for name, found in mesh.interfaces.items()} == {
        "größe <&:/>|middle": ("größe <&:/>", "middle"),
        "joint: a|b": ("right", "middle"),
    }
    mesh.write(tmp_path / f"mesh{suffix}")
    assert_same(mesh, vx.meshes.read(tmp_path / f"mesh{suffix}"))
    assert_same(mesh, pickle.loads(pickle.dumps(mesh)))


@pytest.mark.parametrize("library", ["meshio", "pyvista"])
def test_meshes_of_other_libraries_keep_interfaces(library):
    mesh = three_blocks()
    pytest.importorskip(library)
    assert_same(mesh, vx.meshes.convert(mesh.to(library)))


def test_other_formats_refuse_interfaces(tmp_path):
    mesh = bodies({"a": squares(1), "b": squares(1, ((1, 2), (0, 1)))})
    with pytest.raises(vx.MeshError, match=r"\.msh files do not keep interfaces of bodies. Write .vtu or .vtk"):
        mesh.write(tmp_path / "mesh.msh")


def test_a_file_with_two_bodies_and_no_interface_says_what_to_do(tmp_path):
    mesh = bodies({"a": squares(1), "b": squares(1, ((1, 2), (0, 1)))})
    meshio.Mesh(mesh.points, [("quad", np.stack(mesh.cells))]).write(tmp_path / "mesh.vtu", file_format="vtu")
    with pytest.raises(
        vx.MeshError, match=r"mesh.vtu: nodes 1 and 4 are in the same place, \(1, 0\).*vx.meshes.bodies"
    ):
        vx.meshes.read(tmp_path / "mesh.vtu")


def test_histories_keep_interfaces(tmp_path):
    mesh = bodies({"a": squares(1), "b": squares(1, ((1, 2), (0, 1)))})
    scene = vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp(["a.left", "b.right"]), vx.BodyForce(lambda x, t: x * t))
    vx.simulate(scene, mesh, [0.0, 1.0]).write(tmp_path)
    assert_same(mesh, vx.read_history(tmp_path).mesh)
