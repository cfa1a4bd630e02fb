"""Meshes of scikit-fem: triangles or quadrilaterals, named facets, named sets of cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.names import WHOLE
from vemcvx.meshes.io.blocks import Blocks
from vemcvx.meshes.polygons.shapes import polygon_centroids
from vemcvx.meshes.polygons.topology import positions
from vemcvx.meshes.tessellation import Tessellation

KINDS = {"ElementTriP1": "triangle", "ElementQuad1": "quad"}


def from_skfem(mesh: Any) -> tuple[Floats, Blocks]:
    """Points and cells; named facets are boundaries, subdomains cell data."""
    element = mesh.elem.__name__
    points, cells = np.asarray(mesh.doflocs).T, np.array(mesh.t, dtype=np.int64).T
    if element in KINDS:  # either way around is usual: triangles, say, are sorted by the numbers of their vertices
        clockwise = polygon_centroids(points[cells])[0] < 0.0
        cells[clockwise, 1:] = cells[clockwise, :0:-1]
    blocks = Blocks([(KINDS.get(element, element), cells)])
    for name, facets in (mesh.boundaries or {}).items():
        blocks.edges[name] = np.asarray(mesh.facets, dtype=np.int64)[:, np.asarray(facets)].T
    for name, members in (mesh.subdomains or {}).items():
        blocks.surfaces[name] = [np.isin(np.arange(len(cells)), members)]
    return points, blocks


def to_skfem(mesh: Tessellation) -> tuple[Any, list[str]]:
    """MeshTri or MeshQuad, and the names of cell data that it does not keep."""
    import skfem

    counts = np.unique(np.diff(mesh.offsets)).tolist()
    if counts not in ([3], [4]):
        found = " or ".join(map(str, counts))
        raise MeshError(f"scikit-fem has meshes of triangles or of quadrilaterals; here, cells have {found} vertices.")
    kind = skfem.MeshTri if counts == [3] else skfem.MeshQuad
    made = kind(mesh.points.T.copy(), mesh.vertices.reshape(-1, *counts).T.copy())
    facets: Ints = made.facets.T.astype(np.int64)
    sides = {name: positions(edges, facets, mesh.n_nodes) for name, edges in mesh.boundaries.items() if name != WHOLE}
    sets = {name: np.flatnonzero(v) for name, v in mesh.cell_data.items() if v.ndim == 1 and np.isin(v, (0, 1)).all()}
    return made.with_boundaries(sides).with_subdomains(sets), sorted(set(mesh.cell_data) - set(sets))
