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
from vemcvx.meshes.checks.names import WHOLE, check_boundaries, check_cell_data
from vemcvx.meshes.interfaces import Interface, on_boundary
from vemcvx.meshes.polygon_mesh import PolygonMesh
from vemcvx.meshes.polygons.segments import TOLERANCE
from vemcvx.meshes.polygons.topology import positions
from vemcvx.meshes.several_bodies.coincidence import coincidence_of
from vemcvx.meshes.several_bodies.faults import check_apart, check_points_of_contact
from vemcvx.meshes.several_bodies.matching import interfaces_of
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
        of all bodies. Of two boundaries that do not coincide to rounding, such as two polygons of one circle (which are
        up to h^2 / (8 R) apart, with edges of length h), the later body takes the shape of the earlier one: its nodes
        move to the nearest points of the other's.

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
    check_apart(whole, place, moved=not np.array_equal(found.points, apart.points))
    matched = on_boundary(interfaces_of(whole, place, interfaces), whole.ends, len(whole.points))
    check_points_of_contact(whole, place, matched)
    origin = np.repeat(np.arange(len(apart.ends)), 1 + np.bincount(found.edge, minlength=len(apart.ends)))
    sides = _sides(meshes, apart, whole, origin=origin, interfaces=matched)
    mesh = PolygonMesh.unchecked(whole.points, whole.offsets, whole.vertices)
    return mesh._replace(
        interfaces=MappingProxyType(matched),
        _named=check_boundaries(sides, whole.ends, mesh.n_nodes, None),
        cell_data=MappingProxyType(check_cell_data(_data(meshes, whole.body_of_cell), mesh.n_cells)),
    )


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


def _check_tolerance(tolerance: float | None, points: Floats) -> float:
    extent = float(np.ptp(points, axis=0).max())
    if tolerance is None:
        return max(NEAR * extent, TOLERANCE * float(np.abs(points).max()))
    if not is_real(tolerance) or not 0.0 <= tolerance < extent:
        raise MeshError(
            f"bodies: tolerance must be a length below the extent {extent:.3g} of the bodies; got {brief(tolerance)}."
        )
    return float(tolerance)
