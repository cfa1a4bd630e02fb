"""Which edges of two bodies are in one place: their interfaces."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vemcvx.arrays import Ints, brief
from vemcvx.errors import MeshError
from vemcvx.meshes.checks.names import check_name
from vemcvx.meshes.interfaces import Interface
from vemcvx.meshes.polygons.topology import edge_keys
from vemcvx.meshes.several_bodies.side_by_side import SideBySide


def edges_in_one_place(whole: SideBySide, place: Ints) -> tuple[Ints, Ints]:
    """Pairs (q,), (q,) of edges of the boundary between the same places."""
    keys = edge_keys(place[whole.ends], len(place))
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    return order[same], order[same + 1]


def interfaces_of(
    whole: SideBySide, place: Ints, interfaces: Mapping[str, tuple[str, str]] | None
) -> dict[str, Interface]:
    """The interfaces of bodies that share the places of nodes, under the given names or "first|second"."""
    named = _check_names(interfaces, whole.names)
    one, other = edges_in_one_place(whole, place)
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
