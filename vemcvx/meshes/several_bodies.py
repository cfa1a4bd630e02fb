"""Joining the meshes of several bodies, with interfaces where boundaries coincide.

A node near a node of an earlier body moves to that node. A node near an edge of another body is inserted into the
edge. If the edge belongs to an earlier body, the node moves onto the edge. For polyhedra see :mod:`.overlay`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import SAME, Floats, Ints, brief, is_real, read_only
from vemcvx.base.errors import MeshError
from vemcvx.base.outline import coordinates
from vemcvx.meshes.box import WHOLE, check_cell_data, check_mapping, check_name
from vemcvx.meshes.checks.plane import check_cells, find_misfit, lowest
from vemcvx.meshes.checks.space import check_polyhedral_mesh, find_touching_faces, is_enclosed
from vemcvx.meshes.interfaces import Interface, coinciding_sides, on_boundary, pairs_of, places_of
from vemcvx.meshes.overlay import CORNER_FACTOR, mismatch_error, overlay_tilings
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons import (
    TOLERANCE,
    cell_of_corner,
    close_pairs,
    find_all_in,
    least_of_each,
    offsets_of,
    outlines,
    rounding,
    rows_in_order,
    smallest_linked,
)
from vemcvx.meshes.polyhedra import FaceShapes, list_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

AnyKind = TypeVar("AnyKind", bound=PolygonMesh | PolyhedralMesh)
NARROW_BETWEEN_BODIES = 1e-3  # smallest allowed gap, relative to the smallest cell height
FACING_COSINE = -0.5  # largest cosine between the outward normals of opposite faces
BODY = "body"
RESERVED_CHARACTERS = (".", "|")


def bodies(
    meshes: Mapping[str, AnyKind],
    interfaces: Mapping[str, tuple[str, str]] | None = None,
    *,
    tolerance: float | None = None,
) -> AnyKind:
    """Join the meshes of several bodies into one, with an interface wherever boundaries of two bodies coincide.

    Along an interface, the cells of each body get hanging nodes at the nodes of the other body. In space, faces are
    split. Coinciding nodes stay separate. Bodies need not touch.

    Parameters
    ----------
    meshes : mapping of str to PolygonMesh, or of str to PolyhedralMesh
        Name -> mesh of the body.
    interfaces : mapping of str to (str, str), optional
        Name of the interface -> (first body, second body). The default name is "first|second", in the order of the
        bodies.
    tolerance : float, optional
        Largest distance between coinciding boundaries, by default 1e-9 of the extent of all bodies. Nodes of the later
        body move to the earlier body. If both bodies approximate a circle of radius R by edges of length h, give
        h^2 / (8 R).

    Returns
    -------
    PolygonMesh or PolyhedralMesh
        Cells and nodes are in the order of the bodies. New nodes come last. ``mesh.interfaces`` maps names to
        `Interface`. The boundary "left" of the body "lower" is called "lower.left", and excludes interfaces.
        Cell data are zero on bodies without these data. The cell datum "body" numbers the bodies from 0. The cell datum
        "lower" is 1 in the body "lower" and 0 elsewhere, for ``Elasticity(..., on="lower")``.

    Raises
    ------
    MeshError
        Bodies overlap, touch only in a point or edge, or leave a narrow gap. Curved surfaces in space have different
        nodes. `interfaces` names two bodies without an interface. The tolerance is too large. A name is not allowed.

    Examples
    --------
    >>> lower, upper = vx.meshes.squares(2), vx.meshes.triangles(3, box=((0, 1), (1, 2)))
    >>> list(vx.meshes.bodies({"lower": lower, "upper": upper}, {"joint": ("lower", "upper")}).interfaces)
    ['joint']
    """
    return join(meshes, interfaces, tolerance)[0]


def join(
    meshes: Mapping[str, AnyKind], interfaces: Mapping[str, tuple[str, str]] | None, tolerance: float | None
) -> tuple[AnyKind, Ints]:
    """Return the joined mesh, and a map from boundary sides to sides before joining."""
    _check_meshes(meshes)
    names, each = tuple(meshes), list(meshes.values())
    apart = _side_by_side(each)
    length = _check_tolerance(tolerance, apart.points)
    body = np.repeat(np.arange(len(each)), [mesh.n_nodes for mesh in each])
    in_plane = isinstance(apart, PolygonMesh)
    place = _same_places(names, body, apart, length if in_plane else CORNER_FACTOR * length)
    match: Any = _match_in_plane if in_plane else overlay_tilings
    mesh, body, place, origin = match(apart, body, place, length)
    if in_plane:
        _check_apart(names, mesh, body)
    sides = coinciding_sides(mesh._outlines, place)
    found = on_boundary(_by_name(names, body, sides, interfaces), mesh._outlines)
    mesh = mesh._replace(interfaces=MappingProxyType(found))
    if not in_plane:
        _check_apart_in_space(names, mesh, body, place)
    alone = np.flatnonzero(places_of(pairs_of(found), mesh.points) != place)
    if len(alone):  # nodes of two bodies coincide outside interfaces
        raise _position_error(names, body[[alone[0], place[alone[0]]]], mesh.points[alone[0]])
    if not in_plane:
        try:
            check_polyhedral_mesh(mesh.points, list_faces(mesh.faces), mesh.interfaces)
        except MeshError as error:
            raise MeshError(f"bodies: surfaces do not fit; {error} Give both bodies the same nodes there.") from None
    # Named boundaries exclude interfaces.
    start, named = 0, {}
    for own, given in meshes.items():
        for name, parts in given.boundaries.items():
            left = mesh._outer & np.isin(origin, start + given._places(parts))
            if name != WHOLE and left.any():
                named[f"{own}.{name}"] = read_only(mesh._boundary[left])
        start += len(given._boundary)
    data = check_cell_data(_data(meshes, np.repeat(np.arange(len(each)), [m.n_cells for m in each])), mesh.n_cells)
    return mesh._replace(_named=named, cell_data=MappingProxyType(data)), origin


def _side_by_side(meshes: list[Any]) -> Any:
    """Return one mesh of all bodies, without common nodes."""
    kind, arrays = type(meshes[0]), []
    for name in kind.ARRAYS:
        own = [getattr(mesh, name) for mesh in meshes]
        if name in kind.NUMBERED:
            starts = offsets_of(np.array([getattr(mesh, kind.NUMBERED[name]) for mesh in meshes]))
            own = [np.where(x < 0, -1, x + start) for x, start in zip(own, starts, strict=False)]
        if name.endswith("offsets"):
            arrays.append(offsets_of(np.concatenate([np.diff(x) for x in own])))
        else:
            arrays.append(np.concatenate(own))
    return kind.unchecked(*arrays)


def _same_places(names: tuple[str, ...], body: Ints, mesh: Any, distance: float) -> Ints:
    """Return, for each node, the first nearby node."""
    nodes = np.unique(mesh._outlines[1])
    pairs = nodes[close_pairs(mesh.points[nodes], distance)]
    place = smallest_linked(pairs[body[pairs[:, 0]] != body[pairs[:, 1]]], len(mesh.points))
    key = place * len(names) + body
    _, node, counts = np.unique(key, return_index=True, return_counts=True)
    if (counts > 1).any():
        node = node[np.argmax(counts > 1)]
        raise MeshError(
            f"bodies: two nodes of {names[body[node]]!r} near {coordinates(mesh.points[node], 6)} would move to the "
            f"same place, because both are within {distance:.3g} of a node of another body. The tolerance must be well "
            "below the lengths of edges: give a smaller tolerance=."
        )
    return place


def _match_in_plane(
    apart: PolygonMesh, body: Ints, place: Ints, tolerance: float
) -> tuple[PolygonMesh, Ints, Ints, Ints]:
    """Insert nodes into coinciding edges of other bodies."""
    points, node, edge = _hanging(apart, body, place, tolerance)
    corner, cell = apart.shared_edges.alone[edge], cell_of_corner(apart.offsets)
    counts = np.diff(apart.offsets) + np.bincount(cell[corner], minlength=apart.n_cells)
    vertices = np.insert(apart.vertices, corner + 1, apart.n_nodes + np.arange(len(node)))
    mesh = type(apart).unchecked(np.concatenate([points, points[node]]), offsets_of(counts), vertices)
    body = np.append(body, body[apart._boundary[edge, 0]])
    origin = np.repeat(np.arange(len(apart._boundary)), 1 + np.bincount(edge, minlength=len(apart._boundary)))
    return mesh, body, np.append(place, place[node]), origin


def _hanging(mesh: PolygonMesh, body: Ints, place: Ints, tolerance: float) -> tuple[Floats, Ints, Ints]:
    """Return moved points, hanging nodes (q,), and edges (q,) for the hanging nodes."""
    import shapely

    points, ends, count = mesh.points[place], mesh._boundary, int(body[-1]) + 1
    leaders, edges = np.unique(place[ends]), shapely.linestrings(points[ends])
    number, edge = shapely.STRtree(edges).query(
        shapely.points(points[leaders]), predicate="dwithin", distance=tolerance
    )
    node, other = leaders[number], body[ends[edge, 0]]
    # Bodies without a node at the place get a node on the nearest edge.
    distance = shapely.distance(shapely.points(points[node]), edges[edge])
    without = np.flatnonzero(~np.isin(node * count + other, place * count + body))
    nearest = without[least_of_each((node * count + other)[without], distance[without])]
    node, edge, other, distance = node[nearest], edge[nearest], other[nearest], distance[nearest]
    off = (other < body[node]) & (distance > rounding(points[node], *points[ends[edge]].swapaxes(0, 1)))
    off = np.flatnonzero(off)
    off = off[np.unique(node[off], return_index=True)[1]]  # a node moves to a single edge
    meeting = shapely.shortest_line(edges[edge[off]], shapely.points(points[node[off]]))
    points[node[off]] = shapely.get_coordinates(meeting)[::2]
    points = points[place]
    along = shapely.line_locate_point(shapely.linestrings(points[ends[edge]]), shapely.points(points[node]))
    order = np.lexsort((along, edge))
    return points, node[order], edge[order]


def _by_name(
    names: tuple[str, ...], body: Ints, sides: Sequence[Ints], interfaces: Mapping[str, tuple[str, str]] | None
) -> dict[str, Interface]:
    named = {}
    for name, given in check_mapping(interfaces, "bodies: interfaces", "pairs of bodies").items():
        are_two = isinstance(given, (tuple, list)) and len(given) == 2
        pair = tuple(map(str, given)) if are_two else (brief(given),)
        if frozenset(pair) in named:
            raise MeshError(f"bodies: the interface of {' and '.join(map(repr, pair))} has two names; give it one.")
        named[frozenset(pair)] = check_name(name), pair
    first, second = (body[side[:, 0]] if len(side) else body[:0] for side in sides)
    found = {}
    for a, b in np.unique(np.column_stack([first, second]), axis=0):
        edges, partners = (side[(first == a) & (second == b)] for side in sides)
        own = names[a], names[b]
        name, pair = named.get(frozenset(own), ("|".join(own), own))
        if pair != own:
            edges, partners = partners[:, ::-1], edges[:, ::-1]  # edges have the first body on the left
        found[name] = Interface((pair[0], pair[1]), edges, partners)
    for name, pair in named.values():
        if name not in found:
            there = ", ".join(repr("|".join(interface.bodies)) for interface in found.values())
            raise MeshError(
                f"bodies: interface {name!r} cannot join {' and '.join(map(repr, pair))}: the bodies have no common "
                f"boundary, or a name is wrong. Interfaces: {there or 'none'}. Bring the bodies together, or give a "
                "larger tolerance=."
            )
    return found


def _check_apart(names: tuple[str, ...], mesh: PolygonMesh, body: Ints) -> None:
    try:
        check_cells(mesh.points, mesh.offsets, mesh.vertices)
    except MeshError as error:
        raise MeshError(f"bodies: moving nodes to an interface makes a cell invalid; {error}") from None
    width = NARROW_BETWEEN_BODIES * lowest(mesh.points, mesh.offsets, mesh.vertices)
    of_cell = body[mesh.vertices[mesh.offsets[:-1]]]
    misfit = find_misfit(outlines(mesh.points, mesh.offsets, mesh.vertices), width, of_cell)
    if misfit:
        raise _position_error(names, of_cell[misfit[0]], misfit[1])


def _position_error(names: tuple[str, ...], pair: Ints, at: Floats) -> MeshError:
    a, b = (names[number] for number in sorted(pair))
    point, edge, cure = "a point", "edges", "give tolerance=, the largest distance between them"
    if len(at) == 3:
        point, edge, cure = "a point or an edge", "faces", "give both bodies the same nodes there"
    return MeshError(
        f"bodies: {a!r} and {b!r} overlap near {coordinates(at, 6)}, or touch there only in {point}, or are less than "
        f"{NARROW_BETWEEN_BODIES:g} of the smallest cell height apart. Move one of them. Bodies in contact must have "
        f"{edge} in common; give a clearance as gap= of the contact. If both approximate one curve or curved surface, "
        f"{cure}."
    )


def _check_apart_in_space(names: tuple[str, ...], mesh: PolyhedralMesh, body: Ints, place: Ints) -> None:
    of_face = body[mesh.face_vertices[mesh.face_offsets[:-1]]]
    width = NARROW_BETWEEN_BODIES * float((np.abs(mesh.volumes) / mesh.diameters**2).min())
    free = mesh._boundary[mesh._outer]
    offsets, vertices = rows_in_order(mesh.face_offsets, mesh.face_vertices, free)
    shapes = FaceShapes(mesh.face_areas[free], mesh.face_normals[free], mesh.face_centroids[free])
    upon = free[find_touching_faces(mesh.points, offsets, vertices, shapes, width, body=of_face[free])]
    if upon.size:
        raise _position_error(names, of_face[upon[:, 0]], mesh.face_centroids[upon[1, 0]])
    shared = np.bincount(place)[place] > 1
    rim = np.unique(vertices[~shared[vertices]])
    outwards = np.zeros((mesh.n_nodes, 3))
    np.add.at(outwards, vertices, np.repeat(shapes.normals, np.diff(offsets), axis=0))
    below = (mesh.face_centroids - width * mesh.face_normals)[mesh._boundary]
    places = np.concatenate([mesh.points[rim], mesh.points[rim] + width * outwards[rim], below])
    owner = np.concatenate([body[rim], body[rim], of_face[mesh._boundary]])
    for number in range(len(names)):
        own = rows_in_order(*mesh._outlines, np.flatnonzero(of_face[mesh._boundary] == number))
        x = mesh.points[own[1]]
        near = (places >= x.min(axis=0)) & (places <= x.max(axis=0))
        there = np.flatnonzero((owner != number) & near.all(axis=1))
        inside = there[is_enclosed(places[there], mesh.points, *own)]
        if len(inside):
            raise _position_error(names, np.array([number, owner[inside[0]]]), places[inside[0]])
    # Coinciding nodes need not belong to coinciding faces.
    some = np.flatnonzero(np.logical_and.reduceat(shared[vertices], offsets[:-1]))
    rows, nodes = rows_in_order(offsets, vertices, some)
    one, other = (some[cell_of_corner(rows)[corner]] for corner in find_all_in(place[nodes], place[nodes]))
    cosine = np.einsum("ki,ki->k", shapes.normals[one], shapes.normals[other])
    pocket = one[(of_face[free[one]] != of_face[free[other]]) & (cosine < FACING_COSINE)]
    if len(pocket):
        raise mismatch_error(shapes.centroids[pocket[0]])


def _data(meshes: Mapping[str, AnyKind], body: Ints) -> dict[str, NDArray[Any]]:
    """Return all cell data, with body numbers and masks of bodies."""
    data: dict[str, NDArray[Any]] = {}
    for number, (own, mesh) in enumerate(meshes.items()):
        for name, values in mesh.cell_data.items():
            if name == own and np.array_equal(values, np.ones(mesh.n_cells)):
                continue  # equal to the mask that is added below
            known = data.setdefault(name, np.zeros((len(body), *values.shape[1:]), dtype=values.dtype))
            if known.shape[1:] != values.shape[1:]:
                raise MeshError(f"bodies: the cell datum {name!r} has rows of different shapes on different bodies.")
            data[name] = known = known.astype(np.result_type(known, values))
            known[body == number] = values
    taken = [name for name in (BODY, *meshes) if name in data]
    if taken:
        raise MeshError(f"bodies: a mesh has the cell datum {taken[0]!r}, the name of a body. Rename the datum.")
    return data | {BODY: body} | {name: (body == number).astype(np.uint8) for number, name in enumerate(meshes)}


def _check_meshes(meshes: Mapping[str, AnyKind]) -> None:
    if not isinstance(meshes, Mapping) or len(meshes) < 2:
        raise MeshError(f"bodies: meshes must map names to the meshes of at least two bodies; got {brief(meshes)}.")
    for name, mesh in meshes.items():
        if not isinstance(name, str) or not name or any(sign in name for sign in RESERVED_CHARACTERS) or name == BODY:
            raise MeshError(
                f"bodies: the name of a body must be a string without {' and '.join(RESERVED_CHARACTERS)}, other than "
                f"{BODY!r}; got {brief(name)}."
            )
        if not isinstance(mesh, (PolygonMesh, PolyhedralMesh)) or mesh.interfaces:
            raise MeshError(
                f"bodies: the mesh of {name!r} must be a PolygonMesh or PolyhedralMesh of one body, without "
                f"interfaces; got {brief(mesh)}. Give all bodies at once, a mesh for each."
            )
    if len({mesh.points.shape[1] for mesh in meshes.values()}) > 1:
        raise MeshError("bodies: some meshes are in the plane, and some in space; extrude the plane ones.")


def _check_tolerance(tolerance: float | None, points: Floats) -> float:
    extent = float(np.ptp(points, axis=0).max())
    if tolerance is None:
        return max(SAME * extent, TOLERANCE * float(np.abs(points).max()))
    if not is_real(tolerance) or not 0.0 <= tolerance < extent:
        raise MeshError(
            f"bodies: tolerance must be a length below the extent {extent:.3g} of the bodies; got {brief(tolerance)}."
        )
    return float(tolerance)
