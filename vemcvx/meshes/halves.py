"""Cutting a mesh in two along a line, in space along a plane.

In the plane, each cell that the line crosses becomes two polygons. There is a new node where the line meets an edge,
shared by both cells at the edge. To avoid slivers, inner nodes first move onto the line if their distance from it is at
most `NEAR_FRACTION` times their shortest edge. In space the plane must run along faces: cells are not split.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import SAME, Floats, Ints, one_point, read_only
from vemcvx.base.errors import MeshError, SceneError
from vemcvx.base.outline import coordinates
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.mesh import Mesh
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import corner_edges, offsets_of, rows_in_order

AnyMesh = TypeVar("AnyMesh", bound=Mesh)
NEAR_FRACTION = 0.1
"""Nodes move onto the line if their distance from it is below this fraction of their shortest edge."""


def cut(mesh: AnyMesh, point: ArrayLike, normal: ArrayLike) -> tuple[AnyMesh, AnyMesh]:
    """Return two meshes: the parts of a mesh behind and ahead of a line (in space: of a plane).

    :func:`vemcvx.meshes.bodies` joins both parts again, with the cut as an interface, as `Pretension` of a bolt needs.
    Both parts keep names of boundaries and cell data; edges or faces along the cut have no name. In the plane, cells
    that the line crosses are split. Inner nodes move onto the line if their distance from it is at most a tenth of
    their shortest edge. In space the plane must run along faces.

    Parameters
    ----------
    mesh : PolygonMesh or PolyhedralMesh
        The mesh of one body, without interfaces.
    point, normal : (dim,) array_like
        A point on the line or plane, and a normal vector of any length. The part ahead is on the side of the normal.

    Returns
    -------
    behind, ahead : PolygonMesh or PolyhedralMesh
        The two parts; nodes and cells keep their order, new nodes come last.

    Raises
    ------
    MeshError
        The whole mesh is on one side; the mesh has interfaces; the line meets a nonconvex cell more than twice; in
        space the plane crosses cells.

    Examples
    --------
    >>> import vemcvx as vx
    >>> shank, head = vx.meshes.cut(vx.meshes.squares(4), point=(0.0, 0.4), normal=(0.0, 1.0))
    >>> list(vx.meshes.bodies({"shank": shank, "head": head}).interfaces)
    ['shank|head']
    """
    points, side = _sides(mesh, point, normal)
    offsets, nodes = mesh.cell_nodes
    low, high = (f.reduceat(side[nodes], offsets[:-1]) for f in (np.minimum, np.maximum))
    crossed = np.flatnonzero((low < 0) & (high > 0))
    if len(crossed) and not isinstance(mesh, PolygonMesh):
        at = coordinates(mesh.centroids[crossed[0]], 6)
        raise MeshError(
            f"cut: the plane crosses {len(crossed)} cells, the first at {at}; in space it must run along faces. Move "
            "the plane to nodes of the mesh, or mesh the body with nodes in the plane."
        )
    one_body: Any = mesh
    cells = one_body.cells
    behind, ahead = ([(c, cells[c]) for c in np.flatnonzero(here).tolist()] for here in (high <= 0, low >= 0))
    met: dict[tuple[int, int], int] = {}
    for c in crossed.tolist():
        halves = _split_cell(cells[c].tolist(), side, met, len(points))
        if halves is None:
            at = coordinates(mesh.centroids[c], 6)
            raise MeshError(f"cut: the line meets cell {c} at {at} more than twice; refine it, or move the line.")
        behind.append((c, halves[0]))
        ahead.append((c, halves[1]))
    if not behind or not ahead:
        raise MeshError(f"cut: the whole mesh is {'ahead of' if ahead else 'behind'} the cut; move the cut.")
    # new nodes where edges meet the line
    ends = np.array(list(met), dtype=np.int64).reshape(-1, 2)
    share = np.abs(side[ends]) / np.abs(side[ends]).sum(axis=1, keepdims=True)
    points = np.concatenate([points, share[:, 1:] * points[ends[:, 0]] + share[:, :1] * points[ends[:, 1]]])
    first, second = (_part(mesh, points, sorted(own, key=lambda one: one[0]), met) for own in (behind, ahead))
    return first, second


def _sides(mesh: Mesh, point: ArrayLike, normal: ArrayLike) -> tuple[Floats, Floats]:
    """Return the points, moved onto the line if near to it, and their signed distances (n_nodes,), positive ahead."""
    if not isinstance(mesh, Mesh) or mesh.interfaces:
        raise MeshError("cut: give the mesh of one body, without interfaces; cut the body before joining it to others.")
    try:
        p, n = (
            one_point(x, mesh.points.shape[1], f"cut: {name}") for name, x in (("point", point), ("normal", normal))
        )
    except SceneError as error:
        raise MeshError(str(error)) from None
    if not n.any():
        raise MeshError("cut: the normal has length 0; give one that points ahead, such as (0, 1).")
    n = n / np.linalg.norm(n)
    depth, near = (mesh.points - p) @ n, np.full(mesh.n_nodes, SAME * float(np.ptp(mesh.points, axis=0).max()))
    if not isinstance(mesh, PolygonMesh):
        return mesh.points, np.where(np.abs(depth) <= near, 0.0, depth)
    ends, shortest = corner_edges(mesh.offsets, mesh.vertices), np.full(mesh.n_nodes, np.inf)
    length = np.linalg.norm(mesh.points[ends[:, 1]] - mesh.points[ends[:, 0]], axis=1)
    np.minimum.at(shortest, ends, length[:, None])
    shortest[mesh._boundary] = 0.0
    depth = np.where(np.abs(depth) <= np.maximum(near, NEAR_FRACTION * shortest), 0.0, depth)
    return mesh.points - (((mesh.points - p) @ n) * (depth == 0.0))[:, None] * n, depth


def _split_cell(
    cell: list[int], side: Floats, met: dict[tuple[int, int], int], count: int
) -> tuple[list[int], list[int]] | None:
    """Return the two polygons, behind and ahead, into which the line splits a cell; add new nodes to `met`.

    Return None if the line does not meet the outline exactly twice.
    """
    halves: tuple[list[int], list[int]] = [], []
    hits = 0
    for before, a, b in zip([cell[-1], *cell[:-1]], cell, [*cell[1:], cell[0]], strict=True):
        if side[a] != 0.0:
            halves[int(side[a] > 0)].append(a)
        else:
            hits += 1
            halves[0].append(a)
            halves[1].append(a)
            if not side[before] * side[b] < 0:
                return None
        if side[a] * side[b] < 0:
            hits += 1
            node = met.setdefault((min(a, b), max(a, b)), count + len(met))
            halves[0].append(node)
            halves[1].append(node)
    return halves if hits == 2 else None


def _part(mesh: Any, points: Floats, own: Sequence[tuple[int, Any]], met: dict[tuple[int, int], int]) -> Any:
    """Return the mesh of the cells `own`: pairs (number of the parent cell, vertices or faces of the cell)."""
    parents, cells = zip(*own, strict=True)
    plane = isinstance(mesh, PolygonMesh)
    used = np.unique(np.concatenate([row for cell in cells for row in ((cell,) if plane else cell)]))
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    anew = [number[np.asarray(cell)] if plane else [number[face] for face in cell] for cell in cells]
    data = {name: values[np.array(parents)] for name, values in mesh.cell_data.items()}
    made, named = type(mesh)(points[used], anew, boundaries={}, cell_data=data), {}
    outlines: tuple[Ints, Ints] = mesh._outlines
    for name in mesh.boundaries:
        starts, nodes = rows_in_order(*outlines, mesh._places(mesh.boundaries[name]))
        pieces = [piece for row in np.split(nodes, starts[1:-1]) for piece in _pieces(row.tolist(), met)]
        found = made._find_parts(offsets_of(np.array([len(piece) for piece in pieces])), np.concatenate(pieces), number)
        if name != WHOLE and (found >= 0).any():
            named[name] = read_only(made._boundary[np.unique(found[found >= 0])])
    return made._with_named(named)


def _pieces(row: list[int], met: dict[tuple[int, int], int]) -> Iterator[list[int]]:
    """Yield the pieces of an edge (in space: the face itself), split at its new node, if it has one."""
    node = met.get((min(row), max(row))) if len(row) == 2 else None
    yield from [row] if node is None else ([row[0], node], [node, row[1]])
