"""Motions without strain in words: of the body, of a part of it, or of a body that has a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes import AnyMesh
from vemcvx.vem import split_motion

SMALL = 1e-3
"""What moves by less than this part of the largest motion is not mentioned."""


def body_names(mesh: AnyMesh, piece: Ints, node: Ints) -> list[str | None]:
    """The name of each piece, given as pairs of piece and node, at the interfaces it touches; None without just one."""
    found: list[set[str]] = [set() for _ in range(piece.max() + 1)]
    for joint in mesh.interfaces.values():
        for body, ends in zip(joint.bodies, (joint.edges, joint.partners), strict=True):
            for one in np.unique(piece[np.isin(node, ends)]):
                found[one].add(body)
    return [names.pop() if len(names) == 1 else None for names in found]


@dataclass(frozen=True)
class Part:
    """A part of what is in a scene: pieces that supports, contact or springs join, and how it is called."""

    which: str
    bodies: tuple[str | None, ...]
    """the names of its pieces"""
    hinges: list[int]
    """nodes at which pieces are joined"""

    def moved(self, mode: Floats) -> dict[str, Floats] | None:
        """What each body does that moves, by name; None if one has none."""
        each = mode.reshape(len(self.bodies), -1)
        large = np.flatnonzero(np.abs(each).max(axis=1) > SMALL * np.abs(mode).max())
        names = [self.bodies[one] for one in large]
        if self.hinges or None in names or len(set(names)) < len(names):
            return None
        return {str(name): each[one] for name, one in zip(names, large, strict=True)}

    def motion(self, mode: Floats, directed: bool = False) -> str:
        """A motion in words, and whose it is: which way it goes if it is `directed`, else one way of the two."""
        mode = mode if directed else _forward(mode)
        moved = self.moved(mode)
        if moved is None:
            return f"{self.alone(mode, directed)} of {self.which}"
        return " with ".join(f"{_rigid(own, directed)} of {body}" for body, own in moved.items())

    def alone(self, mode: Floats, directed: bool = False) -> str:
        """A motion in words."""
        if self.hinges:
            return "a motion about hinges"
        return _rigid(mode, directed) if len(self.bodies) == 1 else "a motion of pieces that are joined"


def combined(motions: Sequence[tuple[Part, Floats]], c: Floats) -> str:
    """A combination of motions in words, part by part, and which way it goes."""
    parts: dict[str, tuple[Part, Floats]] = {}
    for share, (part, motion) in zip(c, motions, strict=True):
        sum_so_far = parts[part.which][1] if part.which in parts else 0.0
        parts[part.which] = part, sum_so_far + share * motion
    largest = max(np.abs(motion).max() for _, motion in parts.values())
    large = [(part, motion) for part, motion in parts.values() if np.abs(motion).max() > SMALL * largest]
    return " and ".join(part.motion(motion, directed=True) for part, motion in large)


def floating(part: Part, modes: Floats, points: Floats) -> str:
    """That motions (n, q) of a part meet nothing."""
    count, hinges = modes.shape[1], part.hinges
    if hinges:
        return (
            f"supports: {part.which} is a mechanism: {count} motion(s) without strain meet no support. Cells that "
            f"share single nodes, such as node {hinges[0]} at {points[hinges[0]]}, turn about them like hinges. "
            "Join the cells along edges, or support each piece."
        )
    first = _forward(modes[:, 0])
    moved = part.moved(first)
    motions = f"{count} rigid motion{'s' * (count > 1)}"
    meet = f"meet{'s' * (count == 1)} neither a support nor friction"
    says = f"{part.which} floats: {motions} {meet}, the first {part.alone(first)}"
    if moved is not None:
        ways = " and ".join(f"{body} moves freely by {_rigid(own)}" for body, own in moved.items())
        says = ways if count == 1 else f"{ways}, the first of {motions} that {meet}"
    return (
        f"supports: {says}. Add Clamp, PrescribedDisplacement or BilateralContact where they stop it; friction holds "
        "what slides along its boundary only, and loads hold nothing."
    )


def _forward(mode: Floats) -> Floats:
    """The motion with the sign that makes its largest component positive: of one that goes either way."""
    forward: Floats = mode * np.sign(mode[np.argmax(np.abs(mode))])
    return forward


def _rigid(mode: Floats, directed: bool = False) -> str:
    move, turn = split_motion(np.asarray(np.round(mode / np.linalg.norm(mode), 6) + 0.0))
    rate = np.linalg.norm(turn)
    turns = "a rotation"
    if rate > SMALL and len(turn) > 1:
        turns = f"a rotation about ({_listed(turn / rate)})"
    elif directed:
        turns = "an anticlockwise rotation" if turn[0] > 0 else "a clockwise rotation"
    if rate > 0.9:
        return turns
    moves = f"the translation ({_listed(move)})"
    return moves if rate < SMALL else f"{moves} with {turns}"


def _listed(components: Floats) -> str:
    return ", ".join(f"{component:.2g}" for component in components)
