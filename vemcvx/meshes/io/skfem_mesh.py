"""Meshes of scikit-fem: cells of one kind, named facets, named sets of cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.face_names import matching_faces
from vemcvx.meshes.checks.names import WHOLE
from vemcvx.meshes.io.blocks import Blocks
from vemcvx.meshes.io.by_vertices import by_vertices
from vemcvx.meshes.polygons.shapes import polygon_centroids
from vemcvx.meshes.polygons.topology import positions
from vemcvx.meshes.space_tessellation import SpaceTessellation
from vemcvx.meshes.tessellation import Tessellation

PLANE = {"ElementTriP1": "triangle", "ElementQuad1": "quad"}
KINDS = {**PLANE, "ElementTetP1": "tetra", "ElementHex1": "hexahedron"}
# Where scikit-fem has the vertices of a hexahedron that runs around its bottom, then around its top.
HEXAHEDRON = np.array([0, 3, 6, 2, 1, 5, 7, 4])


def from_skfem(mesh: Any) -> tuple[Floats, Blocks]:
    """Points and cells; named facets are boundaries, subdomains cell data."""
    element = mesh.elem.__name__
    points, cells = np.asarray(mesh.doflocs).T, np.array(mesh.t, dtype=np.int64).T
    if element == "ElementHex1":
        cells = cells[:, HEXAHEDRON]
    if element in PLANE:  # either way around is usual: triangles, say, are sorted by the numbers of their vertices
        clockwise = polygon_centroids(points[cells])[0] < 0.0
        cells[clockwise, 1:] = cells[clockwise, :0:-1]
    blocks = Blocks([(KINDS.get(element, element), cells)])
    for name, facets in (mesh.boundaries or {}).items():
        blocks.edges[name] = np.asarray(mesh.facets, dtype=np.int64)[:, np.asarray(facets)].T
    for name, members in (mesh.subdomains or {}).items():
        blocks.sets[name] = [np.isin(np.arange(len(cells)), members)]
    return points, blocks


def to_skfem(mesh: Tessellation | SpaceTessellation) -> tuple[Any, list[str]]:
    """MeshTri, MeshQuad, MeshTet or MeshHex, and the names of cell data that it does not keep."""
    made = _solid(mesh) if isinstance(mesh, SpaceTessellation) else _plane(mesh)
    facets: Ints = made.facets.T.astype(np.int64)
    named = {name: parts for name, parts in mesh.boundaries.items() if name != WHOLE}
    if isinstance(mesh, SpaceTessellation):
        # The number of the boundary face that each facet is, -1 inside.
        faces = matching_faces(mesh.faces, np.arange(len(facets) + 1) * facets.shape[1], facets.ravel())
        sides = {name: np.flatnonzero(np.isin(faces, chosen)) for name, chosen in named.items()}
    else:
        sides = {name: positions(edges, facets, mesh.n_nodes) for name, edges in named.items()}
    sets = {name: np.flatnonzero(v) for name, v in mesh.cell_data.items() if v.ndim == 1 and np.isin(v, (0, 1)).all()}
    return made.with_boundaries(sides).with_subdomains(sets), sorted(set(mesh.cell_data) - set(sets))


def _plane(mesh: Tessellation) -> Any:
    import skfem

    counts = np.unique(np.diff(mesh.offsets)).tolist()
    if counts not in ([3], [4]):
        found = " or ".join(map(str, counts))
        raise MeshError(f"scikit-fem has meshes of triangles or of quadrilaterals; here, cells have {found} vertices.")
    kind = skfem.MeshTri if counts == [3] else skfem.MeshQuad
    return kind(mesh.points.T.copy(), mesh.vertices.reshape(-1, *counts).T.copy())


def _solid(mesh: SpaceTessellation) -> Any:
    import skfem

    types, offsets, vertices = by_vertices(mesh)
    if len(np.unique(types)) > 1 or types[0] not in (10, 12):
        raise MeshError("scikit-fem has meshes of tetrahedra or of hexahedra; here, there are other cells.")
    cells = vertices.reshape(-1, offsets[1])
    if types[0] == 10:
        return skfem.MeshTet(mesh.points.T.copy(), cells.T.copy())
    return skfem.MeshHex(mesh.points.T.copy(), cells[:, np.argsort(HEXAHEDRON)].T.copy())
