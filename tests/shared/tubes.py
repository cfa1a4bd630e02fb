"""Rings in space, of polygons in place of circles."""

import numpy as np

import vemcvx as vx


def ring(radii, sectors, levels, angle=0.0):
    """Prisms over sectors of rings, or of a disc: of a polygon in place of the circle."""
    around = np.arange(sectors) * 2 * np.pi / sectors + angle
    points = np.concatenate([r * np.column_stack([np.cos(around), np.sin(around)]) for r in radii])
    k, after = np.arange(sectors), np.roll(np.arange(sectors), -1)
    cells = [np.column_stack([k, k + sectors, after + sectors, after]) + n * sectors for n in range(len(radii) - 1)]
    plane = vx.PolygonMesh(points, np.concatenate(cells))
    return plane.extruded(np.linspace(0, 1, levels + 1))
