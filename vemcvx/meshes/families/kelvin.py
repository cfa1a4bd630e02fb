"""Truncated octahedra, which fill space: the cells of Kelvin's foam, with plane faces.

A cell sits in the middle of every cube of a grid, and one about every node of it, of which the box keeps a half, a
quarter or an eighth. Places are whole numbers, in quarters of the cubes: a cell about the origin has its vertices at
all permutations of (0, +-1, +-2) (W. Thomson, Phil. Mag. 24 (1887), 503-514).
"""

from __future__ import annotations

from itertools import product

import numpy as np

from vemcvx.arrays import Ints
from vemcvx.meshes.box import UNIT_CUBE, SpaceCorners, SpaceCount, check_space_box, space_counts, ticks
from vemcvx.meshes.polygons.topology import offsets_of, rows_in_order
from vemcvx.meshes.polyhedra.topology import joined_faces
from vemcvx.meshes.polyhedral_mesh import PolyhedralMesh

VERTICES = np.array([v for v in product(range(-2, 3), repeat=3) if sorted(map(abs, v)) == [0, 1, 2]])


def kelvin(
    n: SpaceCount | None = None, box: SpaceCorners = UNIT_CUBE, seed: int = 0, *, size: float | None = None
) -> PolyhedralMesh:
    """Mesh a box with truncated octahedra, cut in halves, quarters and eighths at its sides.

    Parameters
    ----------
    n, box, seed, size : as of `cubes`
        The cells in the middle of the cubes; there is one more about each node of `cubes`.

    Returns
    -------
    PolyhedralMesh
        Cells in the middle of cubes first, then those about nodes, both layer by layer; nodes layer by layer.
    """
    whole = check_space_box(box)
    counts = np.array(space_counts(n, whole, size, each=2))
    middles = 4 * _grid(counts) + 2
    corners = 4 * _grid(counts + 1)
    # -1, 0, 1 along each axis: on the lower side of the box, inside, on the upper one.
    cut = (corners == 4 * counts).astype(np.int64) - (corners == 0)
    sites = np.concatenate([middles, corners])
    cut = np.concatenate([np.zeros_like(middles), cut])
    blocks, owner = [], []
    for sides in np.unique(cut, axis=0):
        members = np.flatnonzero((cut == sides).all(axis=1))
        for face in _faces(tuple(sides.tolist())):
            blocks.append(sites[members, None] + face)
            owner.append(members)
    width, depth = 4 * counts[:2] + 1
    x, y, z = np.concatenate([block.reshape(-1, 3) for block in blocks]).T
    used, vertices = np.unique((z * depth + y) * width + x, return_inverse=True)
    sizes = np.concatenate([np.full(len(block), block.shape[1]) for block in blocks])
    cells = np.concatenate(owner)
    offsets, vertices = rows_in_order(offsets_of(sizes), vertices, np.argsort(cells, kind="stable"))
    joined = joined_faces(offsets, vertices, offsets_of(np.bincount(cells)))
    at = (used % width, used // width % depth, used // (width * depth))
    lines = (ticks(low, high, 4 * int(count)) for low, high, count in zip(whole.low, whole.high, counts, strict=True))
    points = np.column_stack([line[place] for line, place in zip(lines, at, strict=True)])
    return PolyhedralMesh.unchecked(points, **joined._asdict(), box=whole)


def _grid(counts: Ints) -> Ints:
    """Whole numbers below the counts along x, y and z, (m, 3), layer by layer."""
    z, y, x = np.indices(tuple(counts[::-1].tolist())).reshape(3, -1)
    return np.column_stack([x, y, z])


def _faces(cut: tuple[int, ...]) -> list[Ints]:
    """Faces of a cell about the origin, each (k, 3), outwards: less what is beyond the origin along the axes cut."""
    outwards = [np.array(signs) for signs in product((-1, 1), repeat=3)]
    outwards += [sign * axis for axis in np.eye(3, dtype=np.int64) for sign in (-1, 1)]
    planes = [(out, 3 if out.all() else 2) for out in outwards]
    planes += [(sign * axis, 0) for sign, axis in zip(cut, np.eye(3, dtype=np.int64), strict=True) if sign]
    faces = [_around(VERTICES[VERTICES @ out == height], out) for out, height in planes]
    for axis, sign in enumerate(cut):
        if sign:
            parts = [_below(face, sign * face[:, axis]) for face in faces]
            faces = [part for part in parts if len(part) > 2]
    return faces


def _around(points: Ints, normal: Ints) -> Ints:
    """Points of a convex polygon in order around the normal."""
    arm = points - points.mean(axis=0)
    ahead = arm[0]
    return points[np.argsort(np.arctan2(arm @ np.cross(normal, ahead) / np.linalg.norm(normal), arm @ ahead))]


def _below(face: Ints, height: Ints) -> Ints:
    """The part of a convex polygon where the height of its vertices is not above zero; it cuts edges in the middle."""
    kept = []
    for k in range(len(face)):
        after = (k + 1) % len(face)
        if height[k] <= 0:
            kept.append(face[k])
        if height[k] * height[after] < 0:
            kept.append((face[k] + face[after]) // 2)
    return np.array(kept)
