"""Meshes of large and small cubes. A large cube beside four small cubes has four coplanar faces."""

from __future__ import annotations

from itertools import product

import numpy as np

import vemcvx as vx


def refined_cubes(n, cut=(0,), scale=1.0):
    """Return a mesh of n x n x n cubes of width 2 * scale. Cubes with the numbers `cut` are split into eight."""
    boxes = []
    for number, corner in enumerate(product(range(0, 2 * n, 2), repeat=3)):
        parts = product(range(2), repeat=3) if number in cut else [(0, 0, 0)]
        width = 1 if number in cut else 2
        boxes += [(np.add(corner, part), width) for part in parts]
    nodes = sorted(
        {tuple(np.add(low, np.multiply(part, width))) for low, width in boxes for part in product((0, 1), repeat=3)}
    )
    number = {node: k for k, node in enumerate(nodes)}
    small = {tuple(low) for low, width in boxes if width == 1}
    cells = [[outline(square, number) for square in squares(low, width, small)] for low, width in boxes]
    return vx.PolyhedralMesh(scale * np.array(nodes, dtype=float), cells)


def squares(low, width, small):
    """Yield the corner, width and two axes of each square face of a cube."""
    for axis, up in product(range(3), (False, True)):
        one, other = (axis + 1) % 3, (axis + 2) % 3
        at = np.array(low)
        at[axis] += width if up else 0
        axes = (one, other) if up else (other, one)
        beyond = at.copy()
        beyond[axis] -= 0 if up else 1
        if width == 2 and tuple(beyond) in small:
            for i, j in product(range(2), repeat=2):
                corner = at.copy()
                corner[one] += i
                corner[other] += j
                yield corner, 1, axes
        else:
            yield at, width, axes


def outline(square, number):
    """Return the nodes around a square, including hanging nodes."""
    corner, width, (one, other) = square
    steps = [(one, 1), (other, 1), (one, -1), (other, -1)]
    at, around = corner.copy(), []
    for axis, step in steps:
        for _ in range(width):
            if tuple(at) in number:
                around.append(number[tuple(at)])
            at[axis] += step
    return around
