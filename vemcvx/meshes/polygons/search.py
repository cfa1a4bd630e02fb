"""The door to SciPy's spatial structures, opened when somebody looks: importing them takes 0.3 s."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vemcvx.arrays import Floats, Ints

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


def search_tree(points: Floats) -> cKDTree:
    """A k-d tree of points (n, dim)."""
    from scipy.spatial import cKDTree

    return cKDTree(points)


def delaunay(points: Floats) -> Ints:
    """Triangles (t, 3) of the Delaunay triangulation of points (n, 2)."""
    from scipy.spatial import Delaunay

    return Delaunay(points).simplices
