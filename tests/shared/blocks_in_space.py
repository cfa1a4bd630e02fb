"""Compare linear solvers in space, on a clamped block that touches a rough floor."""

from __future__ import annotations

import numpy as np

import vemcvx as vx
from vemcvx.scene import pose_scene


def pose_block_on_floor(n, traction, bound=1.0, coefficient=None, is_bilateral=True):
    """Return the System of a unit cube that is clamped on the right and loaded by traction(t) on the top.

    The cube has n cells per edge. Friction on the bottom is Tresca's with `bound`, or Coulomb's if `coefficient` is
    given.
    """
    friction = vx.TrescaFriction(bound, on="bottom", while_closed=None if is_bilateral else False)
    scene = vx.Scene(
        vx.Elasticity(2.5, 0.25),
        vx.Clamp(on="right"),
        vx.Traction(lambda x, t: np.tile(traction(t), (len(x), 1)), on="top"),
        vx.BilateralContact(on="bottom") if is_bilateral else vx.UnilateralContact(on="bottom"),
        friction if coefficient is None else vx.CoulombFriction(coefficient, on="bottom"),
    )
    return pose_scene(scene, vx.meshes.cubes(n)).system


def assert_within_both_certificates(system, direct, iterative):
    """Check that runs of both linear solvers agree within their certificates, and that the same nodes stick."""
    assert iterative.certificate.max() <= 1e-8
    apart = iterative.state - direct.state
    distance = np.sqrt(np.maximum(np.einsum("si,si->s", apart, (system.K @ apart.T).T), 0.0))
    allowed = iterative.certificate_total + direct.certificate_total
    allowed = allowed + iterative.certificate_floor + direct.certificate_floor
    assert (distance <= allowed * direct.unit).all()
    assert np.array_equal(iterative.sticking, direct.sticking)
