"""One mesh of several bodies: coincident boundaries become interfaces, names and data get the names of the bodies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.arguments import is_real
from vemcvx.arrays import Floats, Ints, brief
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.cells import check_cells
from vemcvx.meshes.checks.names import WHOLE, check_boundaries, check_cell_data, check_name
from vemcvx.meshes.checks.tiling import check_tiling
from vemcvx.meshes.interfaces import Interface, on_boundary
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons.segments import TOLERANCE
from vemcvx.meshes.polygons.topology import edge_keys, positions
from vemcvx.meshes.several_bodies.coincidence import coincidence_of
from vemcvx.meshes.several_bodies.side_by_side import SideBySide
from vemcvx.meshes.tessellation import Tessellation

# Of the extent of all bodies together: well above the digits that files print, well below any edge.
NEAR = 1e-9
BODY = "body"
SIGNS = (".", "|")


def bodies(
    meshes: Mapping[str, PolygonMesh],
    interfaces: Mapping[str, tuple[str, str]] | None = None,
    *,
    tolerance: float | None = None,
) -> PolygonMesh:
    """Join the meshes of several bodies to one, with an interface wherever boundaries of two of them coincide.

    Along an interface each body takes the nodes of the other as hanging vertices of its cells, so that both
    have the same; nodes in one place stay double. Bodies need not touch, but must neither overlap nor nearly touch.

    Parameters
    ----------
    meshes : mapping of str to PolygonMesh
        The bodies by name.
    interfaces : mapping of str to (str, str), optional
        Names of interfaces: name -> (first body, second body). Otherwise an interface is called "first|second", in the
        order of the bodies.
    tolerance : float, optional
        Boundaries coincide where they are no farther apart than this length; by default 1e-9 of the extent
        of all bodies. Of two boundaries that do not coincide to rounding, such as two polygons of one circle, the later
        body takes the shape of the earlier one: its nodes move to the nearest points of the other's.

    Returns
    -------
    PolygonMesh
        Cells of the bodies one after the other; their nodes likewise, and then the new hanging ones.
        ``mesh.interfaces`` has an `Interface` a name; ``mesh.boundaries`` has its edges of the first body, and
        "lower.left" for what is left of the boundary "left" of "lower" without the interfaces (no such name if nothing
        is). Cell data are those of the bodies, zero on the others; "body" is the number of the body, and a datum of
        the name of each body is 1 on it and 0 elsewhere, so that ``Elasticity(..., on="lower")`` means its cells.

    Raises
    ------
    MeshError
        Bodies overlap, touch in a point only, or leave a gap above the tolerance that is hardly one; an interface is
        named that is none; names clash.
    """
    _check_meshes(meshes)
    apart = SideBySide.of(meshes)
    found = coincidence_of(apart, _check_tolerance(tolerance, apart.points))
    whole = replace(apart, points=found.points).with_hanging(found.points[found.node], found.edge)
    place = np.concatenate([found.place, found.place[found.node]])
    check_cells(whole.points, whole.offsets, whole.vertices)
    check_tiling(whole.points, whole.offsets, place[whole.vertices])
    named = _check_names(interfaces, apart.names)
    matched = on_boundary(_matched(whole, place, named), whole.ends, len(whole.points))
    origin = np.repeat(np.arange(len(apart.ends)), 1 + np.bincount(found.edge, minlength=len(apart.ends)))
    sides = _sides(meshes, apart, whole, origin=origin, interfaces=matched)
    mesh = PolygonMesh.unchecked(whole.points, whole.offsets, whole.vertices)
    return mesh._replace(
        interfaces=MappingProxyType(matched),
        _named=check_boundaries(sides, whole.ends, mesh.n_nodes, None),
        cell_data=MappingProxyType(check_cell_data(_data(meshes, whole.body_of_cell), mesh.n_cells)),
    )


def _matched(whole: SideBySide, place: Ints, named: Mapping[tuple[str, str], str]) -> dict[str, Interface]:
    """Edges of two bodies in the same places, as interfaces."""
    keys = edge_keys(place[whole.ends], len(place))
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    one, other = order[same], order[same + 1]
    first, second = whole.body_of_edge[one], whole.body_of_edge[other]
    backwards = first > second
    one, other = np.where(backwards, other, one), np.where(backwards, one, other)
    found = {}
    for a, b in np.unique(np.sort(np.column_stack([first, second]), axis=1), axis=0):
        here = (whole.body_of_edge[one] == a) & (whole.body_of_edge[other] == b)
        edges, partners = whole.ends[one[here]], whole.ends[other[here]][:, ::-1]
        pair = whole.names[a], whole.names[b]
        name = named.get(pair, named.get(pair[::-1], "|".join(pair)))
        if pair[::-1] in named:
            pair, edges, partners = pair[::-1], partners[:, ::-1], edges[:, ::-1]
        found[name] = Interface(pair, edges, partners)
    missing = [pair for pair, name in named.items() if name not in found]
    if missing:
        (a, b), there = missing[0], ", ".join(repr("|".join(interface.bodies)) for interface in found.values())
        raise MeshError(
            f"bodies: interface {named[a, b]!r} is to be between {a!r} and {b!r}, whose boundaries nowhere coincide; "
            f"there are {there or 'none'}. Bring the bodies together, or give a larger tolerance=."
        )
    return found


def _sides(
    meshes: Mapping[str, PolygonMesh],
    apart: SideBySide,
    whole: SideBySide,
    *,
    origin: Ints,
    interfaces: Mapping[str, Interface],
) -> dict[str, Ints]:
    """What is left of the named boundaries without the interfaces; `origin`: of which edge before each edge is part."""
    joints = [side for found in interfaces.values() for side in (found.edges, found.partners)]
    free = np.ones(len(whole.ends), dtype=bool)
    if joints:
        free[positions(np.concatenate(joints), whole.ends, len(whole.points))] = False
    sides = {}
    for start, (body, mesh) in zip(np.searchsorted(apart.body, np.arange(len(meshes))), meshes.items(), strict=True):
        for name, edges in mesh.boundaries.items():
            of_name = np.zeros(len(apart.ends), dtype=bool)
            of_name[positions(edges + start, apart.ends, len(apart.points))] = True
            left = whole.ends[free & of_name[origin]]
            if name != WHOLE and len(left):
                sides[f"{body}.{name}"] = left
    return sides


def _data(meshes: Mapping[str, PolygonMesh], body: Ints) -> dict[str, NDArray[Any]]:
    """Cell data of all bodies, zero where a body has none, the number of the body, and where each body is."""
    data: dict[str, NDArray[Any]] = {}
    for number, mesh in enumerate(meshes.values()):
        for name, values in mesh.cell_data.items():
            known = data.setdefault(name, np.zeros((len(body), *values.shape[1:]), dtype=values.dtype))
            if known.shape[1:] != values.shape[1:]:
                raise MeshError(f"bodies: the cell datum {name!r} has rows of different shapes on different bodies.")
            data[name] = known = known.astype(np.result_type(known, values))
            known[body == number] = values
    taken = [name for name in (BODY, *meshes) if name in data]
    if taken:
        raise MeshError(
            f"bodies: a mesh has the cell datum {taken[0]!r}, which is to tell the bodies. Name it otherwise."
        )
    return data | {BODY: body} | {name: (body == number).astype(np.uint8) for number, name in enumerate(meshes)}


def _check_meshes(meshes: Mapping[str, PolygonMesh]) -> None:
    if not isinstance(meshes, Mapping) or len(meshes) < 2:
        raise MeshError(
            f"bodies: wanted is a mapping of names to the meshes of two bodies or more; got {brief(meshes)}."
        )
    for name, mesh in meshes.items():
        if not isinstance(name, str) or not name or any(sign in name for sign in SIGNS) or name == BODY:
            raise MeshError(
                f"bodies: a body's name is a string without {' and '.join(SIGNS)}, not {BODY!r}; got {brief(name)}."
            )
        if not isinstance(mesh, Tessellation):
            raise MeshError(f"bodies: found {brief(mesh)} for {name!r} where a PolygonMesh is wanted.")
        if mesh.interfaces:
            raise MeshError(f"bodies: {name!r} has interfaces itself; give all bodies at once, each with its own mesh.")


def _check_names(
    interfaces: Mapping[str, tuple[str, str]] | None, known: tuple[str, ...]
) -> dict[tuple[str, str], str]:
    """(first body, second body) -> name of their interface, as far as given."""
    interfaces = {} if interfaces is None else interfaces
    if not isinstance(interfaces, Mapping):
        raise MeshError(f"bodies: interfaces must map names to pairs of bodies; got {brief(interfaces)}.")
    named: dict[tuple[str, str], str] = {}
    for name, pair in interfaces.items():
        check_name(name)
        given = tuple(pair) if isinstance(pair, (tuple, list)) else ()
        if len(given) != 2 or not all(isinstance(one, str) and one in known for one in given) or given[0] == given[1]:
            raise MeshError(
                f"bodies: interface {name!r} must be between two of the bodies {', '.join(map(repr, known))}; got "
                f"{brief(pair)}."
            )
        if given in named or given[::-1] in named:
            raise MeshError(f"bodies: {given[0]!r} and {given[1]!r} are named twice in interfaces; they have one.")
        named[given] = name
    return named


def _check_tolerance(tolerance: float | None, points: Floats) -> float:
    extent = float(np.ptp(points, axis=0).max())
    if tolerance is None:
        return max(NEAR * extent, TOLERANCE * float(np.abs(points).max()))
    if not is_real(tolerance) or not 0.0 <= tolerance < extent:
        raise MeshError(
            f"bodies: tolerance must be a length below the extent {extent:.3g} of the bodies; got {brief(tolerance)}."
        )
    return float(tolerance)
