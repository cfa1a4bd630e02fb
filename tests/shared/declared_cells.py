"""The declared family on which estimates of the error of a mesh stand to the truth: aspects of 1 to 100, both ways.

Blocks and beams on squares of sides up to 100 to 1, and on the other families stretched up to 16 to 1. Every case has a
mesh for its truth, whose own error is a small part of that of the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from scenes import FAMILIES

import vemcvx as vx

STEEL = vx.Elasticity(young=200.0, poisson=0.3)
TIMES = (0.0, 0.5, 1.0)


@dataclass(frozen=True)
class Case:
    """A scene on a mesh, and the mesh of its truth."""

    name: str
    scene: Callable[[], vx.Scene]
    mesh: Callable[[], vx.PolygonMesh]
    fine: Callable[[], vx.PolygonMesh]


def block():
    """The paper's scene."""

    def pull(x, t):
        return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])

    friction = vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound=4.0, on="bottom")
    return vx.Scene(STEEL, vx.Clamp(on="right"), vx.Traction(pull, on="left"), *friction)


def sheared():
    """A block on its foot, sheared and pulled by parabolas at its head."""

    def pull(x, t):
        s = x[:, 0] * (1 - x[:, 0])
        return t * np.column_stack([4 * s, s])

    return vx.Scene(STEEL, vx.Clamp(on="bottom"), vx.Traction(pull, on="top"))


def heavy():
    """A block that hangs from its top by its weight, beside a force from the left that grows upwards."""
    weight = vx.BodyForce(lambda x, t: t * np.column_stack([x[:, 1], np.full(len(x), -3.0)]))
    return vx.Scene(STEEL, vx.Clamp(on="top"), weight)


def cantilever():
    """A beam, clamped on the left, bent by a parabola of shear on the right."""

    def shear(x, t):
        return t * np.column_stack([np.zeros(len(x)), 6 * x[:, 1] * (1 - x[:, 1])])

    return vx.Scene(STEEL, vx.Clamp(on="left"), vx.Traction(shear, on="right"))


BLOCKS = {"block": (block, 256), "sheared": (sheared, 192), "heavy": (heavy, 192)}
SQUARES = ((8, 8), (16, 16), (32, 4), (64, 4), (128, 4), (256, 8), (200, 2))
CELLS = {1: 12, 4: 6, 16: 4}
"""Cells across the short side of the box in which those of an aspect are made."""


def squares(nx: int, ny: int, length: float = 1.0):
    return vx.meshes.squares((nx, ny), box=((0.0, length), (0.0, 1.0)))


def stretched(family: str, n: int, aspect: int, tall: bool):
    """Cells of a family made in a long box that is pressed into the unit square: across the long side they are flat."""
    sides = np.array([1.0, aspect] if tall else [aspect, 1.0])
    mesh = vx.meshes.FAMILIES[family](n, box=tuple((0.0, side) for side in sides))
    return vx.PolygonMesh(mesh.points / sides, list(mesh.cells), boundaries=mesh.boundaries)


def cases() -> Iterator[Case]:
    for name, (scene, n) in BLOCKS.items():
        for pair in [*SQUARES, *(pair[::-1] for pair in SQUARES if pair[0] != pair[1])]:
            # Nested: 200 columns divide 400 of the truth, not 256.
            fine = {200: (400, 100), 2: (100, 400)}.get(pair[0], (n, n))
            yield Case(f"{name} {pair[0]}x{pair[1]}", scene, partial(squares, *pair), partial(squares, *fine))
        for family in (name for name in FAMILIES if name != "squares"):
            for aspect, cells in CELLS.items():
                for tall in (False, True)[: 1 if aspect == 1 else 2]:
                    mesh = partial(stretched, family, cells, aspect, tall)
                    yield Case(f"{name} {family} {aspect}{'hv'[tall]}", scene, mesh, partial(squares, n, n))
    for aspect in (1, 4, 10, 20, 100):
        for n in (4, 8, 16):
            mesh, fine = (n, n, float(aspect)), (256 * min(aspect, 10), 256 if aspect == 1 else 64, float(aspect))
            yield Case(f"cantilever {aspect} {n}", cantilever, partial(squares, *mesh), partial(squares, *fine))
