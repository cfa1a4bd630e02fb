"""Which rows of contact have one normal: those of one node, or pair of nodes, up to rounding.

Parts of a side that are named apart have normals of their own at the node where they meet, which differ by what the
points of a straight side are rounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.effects import ContactSurface, Friction, Obstacle, Support
from vemcvx.scene.jumps import Jumps
from vemcvx.scene.supports import PARALLEL, STRAIGHT

Part = TypeVar("Part", Friction, Obstacle, ContactSurface)


def merged(
    jumps: Jumps, normals: Floats, signed: bool = False, kinds: Ints | None = None, within: float = PARALLEL
) -> tuple[Ints, Ints]:
    """Rows of one jump, kind and normal (up to sign) are one term: its first row, and the term of every row."""
    pairs, term = jumps.distinct[1], np.full(len(jumps), -1)
    first = [term[:0]]
    while (term < 0).any():
        left = np.flatnonzero(term < 0)
        lead = left[np.unique(pairs[left], return_index=True)[1]]
        leader = np.full(pairs.max() + 1, -1)
        leader[pairs[lead]] = np.arange(len(lead))
        mine = leader[pairs[left]]
        reference = normals[lead[mine]]
        cosine = np.einsum("ij,ij->i", normals[left], reference)
        apart = np.linalg.norm(normals[left] - cosine[:, None] * reference, axis=1)
        same = (apart < within) & ((cosine > 0) | (not signed))
        if kinds is not None:
            same &= kinds[left] == kinds[lead[mine]]
        term[left[same]] = mine[same] + sum(map(len, first))
        first.append(lead)
    return np.concatenate(first), term


def straightened(
    earlier: Sequence[Support | Friction | Obstacle | ContactSurface], parts: Sequence[Part]
) -> tuple[Part, ...]:
    """The parts, with the directions of earlier ones at the same nodes where their normals are nearly these."""
    if not parts:
        return ()
    jumps, everything = Jumps.of([*earlier, *parts]), (*earlier, *parts)
    each = np.concatenate([part.directions if isinstance(part, Support) else part.normals for part in everything])
    first, group = merged(jumps, each, within=STRAIGHT)
    straight = each[first][group]
    straight *= np.sign(np.einsum("ij,ij->i", each, straight))[:, None]
    turned = np.linalg.norm(each - straight, axis=1) > PARALLEL
    normals = np.split(np.where(turned[:, None], straight, each), np.cumsum([len(part.nodes) for part in everything]))
    return tuple(replace(part, normals=own) for part, own in zip(parts, normals[len(earlier) :], strict=False))
