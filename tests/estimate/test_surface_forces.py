"""Contact forces on boundary edges, recovered from the forces at nodes."""

from __future__ import annotations

import numpy as np
from scenes import mostly_long

import vemcvx as vx
from vemcvx.bound.skeleton import instant, skeleton
from vemcvx.estimate.residual import Residuals
from vemcvx.scene import pose_scene

SLOPE = np.tan(np.radians(30.0))


def block_with_a_slope(n=8):
    """Return a block whose bottom is level on the left half, and rises by 30 degrees on the right half."""
    square = vx.meshes.squares(n)
    x, y = square.points.T
    bent = np.column_stack([x, y + (1 - y) * SLOPE * np.maximum(x - 0.5, 0)])
    mesh = vx.PolygonMesh(bent, [list(c) for c in square.cells])
    mesh = mesh.with_boundary("level", lambda x: x[:, 1] < 1e-9)
    mesh = mesh.with_boundary("slope", lambda x: (x[:, 1] < SLOPE * (x[:, 0] - 0.5) + 1e-9) & (x[:, 0] > 0.5))
    return mesh.with_boundary("top", lambda x: x[:, 1] > 1 - 1e-9)


@mostly_long("on", ["level", ["level", "slope"]], 1)
def test_contact_edges_alone_bear_the_whole_contact_force(on):
    mesh = block_with_a_slope()
    scene = vx.Scene(
        vx.Elasticity(100.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.01 * t, -0.05 * t], (len(x), 1)), on="top"),
        vx.NormalCompliance(1e3, on=on),
        vx.CoulombFriction(0.3, on=on),
    )
    history, posed = vx.simulate(scene, mesh, [0, 1]), pose_scene(scene, mesh)
    edges, contact = skeleton(posed), history.contact
    force = Residuals(posed).contact(instant(history, -1))
    traction = contact.traction[-1] - contact.pressure[-1][:, None] * contact.normals
    assert np.allclose(force.sum(axis=0), contact.lengths @ traction, rtol=1e-12, atol=1e-12)
    edges_on = np.concatenate([mesh.boundaries[name] for name in np.atleast_1d(on)])
    inside = np.isin(edges.outer_edges, edges_on).all(axis=1)
    assert np.abs(force[inside]).max() > 0
    assert not force[~inside].any()
