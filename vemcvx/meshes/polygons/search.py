"""The door to SciPy's spatial structures, opened when somebody looks: importing them takes 0.3 s."""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError


def close_pairs(points: Floats, distance: float) -> Ints:
    """Pairs (m, 2) of points (n, dim) that are no farther apart than a distance."""
    from scipy.spatial import cKDTree

    return cKDTree(points).query_pairs(distance, output_type="ndarray").astype(np.int64)


def nearest(points: Floats, places: Floats) -> tuple[Floats, Ints]:
    """Distance (m,) from each place (m, dim) to the nearest of the points (n, dim), and its number (m,)."""
    from scipy.spatial import cKDTree

    distance, number = cKDTree(points).query(places)
    return np.asarray(distance, dtype=float), np.asarray(number, dtype=np.int64)


def delaunay(points: Floats) -> Ints:
    """Triangles (t, 3) of the Delaunay triangulation of points (n, 2), or MeshError if these are on one line."""
    from scipy.spatial import Delaunay, QhullError

    try:
        return Delaunay(points).simplices.astype(np.int64)
    except QhullError as error:
        raise MeshError(f"{len(points)} points have no triangulation: they are all but on one line.") from error


def voronoi_faces(sites: Floats) -> tuple[Floats, Ints, list[list[int]]]:
    """Voronoi cells of sites (n, 3): corners (m, 3), and of each face the two sites (f, 2) and its corners in order.

    A corner at infinity has the number -1.
    """
    from scipy.spatial import Voronoi

    found = Voronoi(sites)
    return found.vertices, found.ridge_points.astype(np.int64), found.ridge_vertices
