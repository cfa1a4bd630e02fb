"""Cases on which estimated mesh errors are compared with true errors: flat and tall cells with aspect ratios up to 100.

Blocks and beams have meshes of rectangles with ratios up to 100. Blocks also have meshes of all other families, with
ratios up to 16. Every case has a finer reference mesh.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from scenes import FAMILIES, paper_scene

import vemcvx as vx

STEEL = vx.Elasticity(young=200.0, poisson=0.3)
TIMES = (0.0, 0.5, 1.0)


@dataclass(frozen=True)
class Case:
    """A scene with its mesh and a finer reference mesh."""

    name: str
    scene: Callable[[], vx.Scene]
    mesh: Callable[[], vx.PolygonMesh]
    fine: Callable[[], vx.PolygonMesh]


def sheared():
    """Return a block that is clamped at its foot, and loaded at its head by parabolic shear and tension."""

    def pull(x, t):
        s = x[:, 0] * (1 - x[:, 0])
        return t * np.column_stack([4 * s, s])

    return vx.Scene(STEEL, vx.Clamp(on="bottom"), vx.Traction(pull, on="top"))


def heavy():
    """Return a block that hangs from the top, under weight and a horizontal body force."""
    weight = vx.BodyForce(lambda x, t: t * np.column_stack([x[:, 1], np.full(len(x), -3.0)]))
    return vx.Scene(STEEL, vx.Clamp(on="top"), weight)


def cantilever():
    """Return a beam that is clamped on the left and bent by parabolic shear on the right."""

    def shear(x, t):
        return t * np.column_stack([np.zeros(len(x)), 6 * x[:, 1] * (1 - x[:, 1])])

    return vx.Scene(STEEL, vx.Clamp(on="left"), vx.Traction(shear, on="right"))


BLOCKS = {"block": (paper_scene, 256), "sheared": (sheared, 192), "heavy": (heavy, 192)}
SQUARES = ((8, 8), (16, 16), (32, 4), (64, 4), (128, 4), (256, 8), (200, 2))
CELLS = {1: 12, 4: 6, 16: 4}
"""Aspect ratio -> number of cells across the short side of the box."""


def squares(nx: int, ny: int, length: float = 1.0):
    return vx.meshes.squares((nx, ny), box=((0.0, length), (0.0, 1.0)))


def stretched(family: str, n: int, aspect: int, tall: bool):
    """Return a mesh of the unit square with flat or tall cells."""
    sides = np.array([1.0, aspect] if tall else [aspect, 1.0])
    mesh = vx.meshes.FAMILIES[family](n, box=tuple((0.0, side) for side in sides))
    return vx.PolygonMesh(mesh.points / sides, list(mesh.cells), boundaries=mesh.boundaries)


def cases() -> Iterator[Case]:
    for name, (scene, n) in BLOCKS.items():
        for pair in [*SQUARES, *(pair[::-1] for pair in SQUARES if pair[0] != pair[1])]:
            # All nodes of the tested mesh are nodes of the reference mesh.
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
