"""Which vertices of a polygonal cell are its corners.

A vertex where the outline goes straight on hangs on a side; the others are *bends*. Not every bend is a corner: were
the middles on both sides of a bend of 175 degrees joined to the centre, then a quarter with that angle would be
left, whose quarters would have it again and again. So a corner is a bend by at least `SHARP`, or one in a row of
gentler bends, like those of a many-sided polygon, by which the outline has turned another `TURN`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.meshes.polygons.ragged import first_in_row, rotation
from vemcvx.meshes.polygons.segments import cross, rounding
from vemcvx.meshes.polygons.topology import next_vertex, previous_corner
from vemcvx.meshes.tessellation import Tessellation

# Sine of the angle below which an edge goes straight on; beyond the rounding of the coordinates it means nothing.
STRAIGHT = 1e-6
SHARP, TURN = np.radians(20.0), np.radians(40.0)


@dataclass(frozen=True, eq=False)
class Outline:
    """Edges and angles of all cells, (n_corners,) each, at the corners of the mesh.

    Attributes
    ----------
    length : float
        Length of the edge that starts there.
    turn : float
        Angle by which the outline turns left there; zero where it goes straight on.
    bend, corner : bool
        Whether it turns at all, and whether that makes a corner.
    """

    length: Floats
    turn: Floats
    bend: Bools
    corner: Bools


def outline_of(mesh: Tessellation) -> Outline:
    """Measure the outlines of all cells and find their corners."""
    x = mesh.points[mesh.vertices]
    edge = mesh.points[next_vertex(mesh.offsets, mesh.vertices)] - x
    length = np.hypot(edge[:, 0], edge[:, 1])
    before = previous_corner(mesh.offsets)
    sine, cosine = cross(edge[before], edge), np.einsum("ij,ij->i", edge[before], edge)
    slack = STRAIGHT * length[before] * length + rounding(x) * (length[before] + length)
    bend = at_least_three((np.abs(sine) > slack) | (cosine <= 0.0), np.ones(len(x), dtype=bool), mesh.offsets)
    turn = np.where(bend, np.arctan2(sine, cosine), 0.0)
    return Outline(length, turn, bend, at_least_three(_corners(turn, mesh.offsets), bend, mesh.offsets))


def at_least_three(flags: Bools, otherwise: Bools, offsets: Ints) -> Bools:
    """The flags, but those of ``otherwise`` in cells with less than three of them."""
    few = np.add.reduceat(flags.astype(np.int64), offsets[:-1]) < 3
    return np.where(np.repeat(few, np.diff(offsets)), otherwise, flags)


def _corners(turn: Floats, offsets: Ints) -> Bools:
    """Sharp bends, and those of the others where the turn since the last sharp one passes 20, 60, 100 ... degrees."""
    sharp: Bools = np.abs(turn) > SHARP
    gentle = np.flatnonzero(np.logical_or.reduceat((turn != 0.0) & ~sharp, offsets[:-1]))
    if not len(gentle):
        return sharp
    order = rotation(offsets, first_in_row(sharp, offsets))
    fresh = sharp[order]
    fresh[offsets[:-1]] = True
    step = np.where(sharp, 0.0, turn)[order]
    total = np.cumsum(step)
    since = np.maximum.accumulate(np.where(fresh, np.arange(len(order)), 0))
    turned = np.rint((total - (total - step)[since]) / TURN)
    passed = np.concatenate([[False], turned[1:] != turned[:-1]]) & ~fresh & (step != 0.0)
    corner = sharp.copy()
    corner[order[passed]] = True
    return corner
