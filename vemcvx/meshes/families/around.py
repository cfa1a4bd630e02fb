"""Rings and discs of sectors: plane meshes of round bodies, prisms over which are cylinders and tubes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats, brief, plain
from vemcvx.errors import MeshError
from vemcvx.meshes.box import LARGEST, SHORTEST, check_total, check_whole
from vemcvx.meshes.polygon_mesh import PolygonMesh

# Nodes stand on circles, and sides are chords: of the area of a circle of radius r, a polygon of s sides lacks the part
# 2 pi^2 / (3 s^2), and it is r (1 - cos(pi / s)) inside of the circle at most.


TURN = 2.0 * np.pi


def ring(radii: ArrayLike, sectors: int, *, angles: tuple[float, float] = (0.0, TURN)) -> PolygonMesh:
    """Mesh a ring, a disc or a part of them with quadrilaterals between circles and rays.

    ``ring(...).extruded(heights)`` is a tube of hexahedra, and a cylinder of wedges and hexahedra.

    Parameters
    ----------
    radii : (k,) array
        Radii of the circles, increasing, k >= 2: ``np.geomspace(a, b, k)`` for cells of one shape. If the first is 0,
        the body is a disc, with triangles about the centre.
    sectors : int
        Sides of a circle; at least 3 of a whole turn, and more than the angle over pi.
    angles : (float, float), optional
        Where the first and the last ray stand, from x counter-clockwise, in radians; a whole turn closes.

    Returns
    -------
    PolygonMesh
        Nodes and cells circle by circle, a centre first, counter-clockwise from the first ray. Boundaries "outer",
        "inner" but of a disc, of a part of a turn "first" and "last" (the rays), and "boundary".

    Raises
    ------
    MeshError
        Radii are negative or do not increase, the angle is no part of a turn, or there are too few sectors for it.

    Examples
    --------
    >>> import numpy as np, vemcvx as vx
    >>> vx.meshes.ring(np.linspace(1.0, 2.0, 5), 48).extruded(np.linspace(0.0, 3.0, 7)).n_cells
    1152
    """
    r = _increasing(radii)
    start, end = _rays(angles)
    check_whole("sectors", sectors, int((end - start) / np.pi) + 1)
    check_total(sectors * (len(r) - 1))
    turns, disc = end - start > TURN * (1 - 1e-12), r[0] == 0.0
    rays = sectors if turns else sectors + 1
    unit = _directions(start, end, sectors)[:rays]
    centre = np.zeros(int(disc), dtype=np.int64)
    points = np.concatenate([np.zeros((len(centre), 2)), (r[len(centre) :, None, None] * unit).reshape(-1, 2)])
    around = np.column_stack([np.arange(sectors), np.arange(1, sectors + 1) % rays])
    circles = len(centre) + np.arange(len(r) - len(centre)) * rays
    inner, outer = circles[:-1, None, None] + around, circles[1:, None, None] + around
    quads = np.concatenate([inner[..., :1], outer, inner[..., 1:]], axis=2).reshape(-1, 4)
    middle = np.insert(circles[0] + around, 0, 0, axis=1) if disc else quads[:0]
    parts = {"outer": circles[-1] + around} | ({} if disc else {"inner": circles[0] + around})
    if not turns:
        for name, ray in (("first", circles), ("last", circles + sectors)):
            along = np.append(centre, ray)
            parts[name] = np.column_stack([along[:-1], along[1:]])
    return PolygonMesh(points, [*middle, *quads], boundaries=parts)


def _increasing(radii: ArrayLike) -> Floats:
    wanted = "at least two increasing numbers >= 0, the radii of circles"
    given = plain(radii)
    if given is None or given.dtype.kind not in "iuf" or given.ndim != 1 or len(given) < 2:
        raise MeshError(f"ring: found radii = {brief(radii)}; wanted {wanted}.")
    r = given.astype(float)
    if not np.isfinite(r).all() or r[0] < 0 or np.diff(r).min() < SHORTEST:
        raise MeshError(f"ring: found radii = {brief(radii)}; wanted {wanted}.")
    if r[-1] > LARGEST:
        raise MeshError(f"ring: found a radius of {r[-1]:g}; at most {LARGEST:g} can be computed with.")
    return r


def _rays(angles: tuple[float, float]) -> tuple[float, float]:
    """The angles of the first and of the last ray."""
    wanted = "two increasing angles in radians, at most a turn apart"
    given = plain(angles)
    if given is not None and given.dtype.kind in "iuf" and given.shape == (2,) and np.isfinite(given).all():
        start, end = map(float, given)
        if 0 < end - start <= TURN * (1 + 1e-12):
            return start, end
    raise MeshError(f"ring: found angles = {brief(angles)}; wanted {wanted}.")


def _directions(start: float, end: float, sectors: int) -> Floats:
    """Unit vectors (sectors + 1, 2) of the rays; those along an axis are on it to the bit."""
    angle = start + (end - start) * np.arange(sectors + 1) / sectors
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    unit[np.abs(unit) < 1e-15 * max(1.0, abs(start), abs(end))] = 0.0
    return unit
