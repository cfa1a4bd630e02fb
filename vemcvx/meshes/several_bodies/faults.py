"""Bodies that overlap, touch in a point, or all but touch: what is told, and where."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.cells import check_cells
from vemcvx.meshes.checks.fitting import NARROW_BETWEEN_BODIES, Misfit, misfit_of, shortest_edges
from vemcvx.meshes.interfaces import Interface, pairs_of, places_of
from vemcvx.meshes.polygons.segments import cross
from vemcvx.meshes.polygons.topology import directed_edges
from vemcvx.meshes.several_bodies.matching import edges_in_one_place
from vemcvx.meshes.several_bodies.side_by_side import SideBySide


def check_apart(whole: SideBySide, place: Ints, *, moved: bool) -> None:
    """MeshError where bodies that share the places of nodes overlap, or leave a gap that is hardly one.

    Outlines without the edges that two bodies have in one place, in opposite directions, bound all bodies together, and
    what is true of the boundary of one mesh must be true of them. If nodes were moved, so are cells, and checked again.
    """
    if moved:
        try:
            check_cells(whole.points, whole.offsets, whole.vertices)
        except MeshError as error:
            raise MeshError(f"bodies: nodes that were moved to an interface spoil a cell; {error}") from None
    one, other = edges_in_one_place(whole, place)
    ends, body = place[whole.ends], whole.body_of_edge
    third = np.flatnonzero(other[:-1] == one[1:])
    first, second = np.concatenate([one, one[third]]), np.concatenate([other, other[third + 1]])
    same_side = np.flatnonzero(ends[first, 0] == ends[second, 0])
    if len(same_side):
        edge, another = first[same_side[0]], second[same_side[0]]
        raise MeshError(_overlap(whole, body[[edge, another]], whole.points[ends[edge]].mean(axis=0)))
    free = np.setdiff1d(np.arange(len(ends)), np.concatenate([one, other]))
    shortest = shortest_edges(whole.points, place[directed_edges(whole.offsets, whole.vertices)])
    misfit = misfit_of(whole.points, ends[free], shortest, body[free])
    if misfit:
        raise MeshError(_sentence(whole, misfit, ends[free], body=body[free], shortest=shortest))


def check_points_of_contact(whole: SideBySide, place: Ints, interfaces: Mapping[str, Interface]) -> None:
    """MeshError where bodies share a place of nodes, but no interface goes there."""
    joined = places_of(pairs_of(interfaces), whole.points)
    alone = np.flatnonzero(joined != place)
    if len(alone):
        node = alone[0]
        a, b = (whole.names[number] for number in sorted(whole.body[[place[node], node]]))
        raise MeshError(
            f"bodies: {a!r} and {b!r} touch only in the point {_at(whole.points[node])}, which is no interface. Leave "
            "a gap there, or let them share an edge."
        )


def _sentence(whole: SideBySide, misfit: Misfit, ends: Ints, *, body: Ints, shortest: Floats) -> str:
    """A misfit of edges (as places) of the given bodies in words."""
    a, b = whole.points[ends[misfit.edge]]
    c, d = whole.points[ends[misfit.other]]
    if misfit.kind == "crossing":
        at = a + cross(c - a, d - c) / cross(b - a, d - c) * (b - a)
        return _overlap(whole, body[[misfit.edge, misfit.other]], at)
    if misfit.kind == "covered":
        own = body[misfit.edge]
        for another in np.setdiff1d(body, own):
            two = np.isin(body, (own, another))
            found = misfit_of(whole.points, ends[two], shortest, body[two])
            if found and found.kind == "covered":
                return _overlap(whole, np.array([own, another]), 0.5 * (a + b))
    names = " and ".join(repr(whole.names[k]) for k in body[[misfit.edge, misfit.other]])
    return (
        f"bodies: {names} are apart by {misfit.distance:.3g} near {_at(c)}, less than {NARROW_BETWEEN_BODIES:g} of the "
        "edges there, and without an interface never in contact. Bring them together (tolerance= matches what is "
        "farther apart than rounding; a clearance is the gap= of a contact), or leave a larger gap."
    )


def _overlap(whole: SideBySide, pair: Ints, at: Floats) -> str:
    a, b = (whole.names[number] for number in np.sort(pair))
    return (
        f"bodies: {a!r} and {b!r} overlap near {_at(at)}. Move one of them; if their boundaries are two polygons of "
        "one curve, give tolerance=, the largest distance between these."
    )


def _at(point: Floats) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g})"
