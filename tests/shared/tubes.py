"""Tubes in space, with polygons in place of circles."""

import numpy as np

import vemcvx as vx


def ring(radii, sectors, levels, angle=0.0):
    """Return a tube of hexahedra over the sectors of a ring."""
    flat = vx.meshes.ring(radii, sectors, angles=(angle, angle + 2 * np.pi))
    return flat.extruded(np.linspace(0, 1, levels + 1))
