"""Checks of meshes, boundaries and interfaces."""

from __future__ import annotations

import numpy as np

import vemcvx as vx
from vemcvx.meshes.interfaces import faces_of


def label(mesh):
    """Return the mesh with a boundary of an unusual name, and cell data of several types."""
    random = np.random.default_rng(1)
    return (
        mesh.with_boundary('größe <& "x"> of all', lambda x: x[:, 0] < np.median(x[:, 0]))
        .with_cell_data("young's modulus / Pa", random.random(mesh.n_cells))
        .with_cell_data("material", np.arange(mesh.n_cells) % 3)
        .with_cell_data("single", random.random(mesh.n_cells).astype(np.float32))
        .with_cell_data("vector", random.random((mesh.n_cells, 3)))
    )


def assert_same(one, other, *, arrays=None, parts=("boundaries", "cell_data")):
    """Check that two meshes of the same type are equal, by default in all arrays and names."""
    assert type(one) is type(other)
    for name in one.ARRAYS if arrays is None else arrays:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for part in parts:
        mine, theirs = getattr(one, part), getattr(other, part)
        assert set(mine) == set(theirs)
        for name, values in mine.items():
            np.testing.assert_array_equal(values, theirs[name])
            assert values.dtype == theirs[name].dtype
    assert {name: of.bodies for name, of in one.interfaces.items()} == {
        n: i.bodies for n, i in other.interfaces.items()
    }
    for name, found in one.interfaces.items():
        np.testing.assert_array_equal(found.edges, other.interfaces[name].edges)
        np.testing.assert_array_equal(found.partners, other.interfaces[name].partners)


def measure_part(mesh, name):
    """Return the length, in space the area, of a named part of the boundary."""
    if not isinstance(mesh, vx.PolygonMesh):
        return mesh.face_areas[mesh.boundaries[name]].sum()
    ends = mesh.points[mesh.boundaries[name]]
    return np.hypot(*(ends[:, 1] - ends[:, 0]).T).sum()


def assert_matched(mesh):
    """Check the interfaces and the validity of a mesh."""
    for found in mesh.interfaces.values():
        there = found.edges >= 0
        np.testing.assert_array_equal(mesh.points[found.edges[there]], mesh.points[found.partners[there]])
        assert not np.isin(found.edges[there], found.partners[there]).any()
        for side, body in zip((found.edges, found.partners), found.bodies, strict=True):
            owners = mesh._owners[faces_of(side, mesh._outlines)]
            assert (mesh.cell_data[body][owners] == 1).all()
    assert_same(type(mesh)(mesh.points, mesh.cells, interfaces=mesh.interfaces), mesh, parts=())
