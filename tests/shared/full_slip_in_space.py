"""Full slip in space: the closed form of problems/manufactured_full_slip.py in x and z, plus a slip along y.

    u = t e^{xz} / 6 (x (1 + c), b x, z (c - 1)),    c = 1 / (1 + lambda), b = ASIDE,

Lame's constants are lambda and mu = 1. On the floor, where z = 0, we have u_z = 0 and d_z (u_x, u_y) = x (u_x, u_y).
Friction is opposite to the slip, with the bound g = mu x |(u_x, u_y)|.
"""

from __future__ import annotations

import numpy as np

import manufactured_full_slip as plane
import vemcvx as vx
from vemcvx.meshes.polygons import cell_of_corner, next_corner, rows_in_order
from vemcvx.vem import Space, strains

ASIDE = 0.7


def displacement(x, t, lam):
    in_plane = plane.displacement(x[:, 0], x[:, 2], t, lam)
    aside = ASIDE * t / 6 * x[:, 0] * np.exp(x[:, 0] * x[:, 2])
    return np.column_stack([in_plane[:, 0], aside, in_plane[:, 1]])


def strain(x, t, lam):
    """Return the strains (..., 6): e_xx, e_yy, e_zz, 2 e_xy, 2 e_yz, 2 e_xz."""
    xx, zz, xz = plane.strain(x[:, 0], x[:, 2], t, lam).T
    growth = ASIDE * t / 6 * np.exp(x[:, 0] * x[:, 2])
    return np.column_stack([xx, 0 * xx, zz, growth * (1 + x[:, 0] * x[:, 2]), growth * x[:, 0] ** 2, xz])


def body_force(x, t, lam):
    along, z = x[:, 0], x[:, 2]
    in_plane = plane.body_force(along, z, t, lam)
    laplacian = ASIDE * t / 6 * np.exp(along * z) * (2 * z + along * z**2 + along**3)
    return np.column_stack([in_plane[:, 0], -plane.MU * laplacian, in_plane[:, 1]])


def scene(poisson=0.3, pulled=False):
    lam = plane.lame(poisson)

    def on_top(x, t):
        """Return sigma n on z = 1."""
        in_plane = plane.traction_on_top(x[:, 0], x[:, 2], t, lam)
        return np.column_stack([in_plane[:, 0], plane.MU * strain(x, t, lam)[:, 4], in_plane[:, 1]])

    held = ["left", "right", "front", "back"] + ([] if pulled else ["top"])
    slip = np.hypot(1.0 + 1.0 / (1.0 + lam), ASIDE) / 6
    return vx.Scene(
        vx.Elasticity(young=2 * plane.MU * (1 + poisson), poisson=poisson),
        vx.BodyForce(lambda x, t: body_force(x, t, lam)),
        vx.PrescribedDisplacement(lambda x, t: displacement(x, t, lam), on=held),
        *([vx.Traction(on_top, on="top")] if pulled else []),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(lambda x, t: t * plane.MU * slip * x[:, 0] ** 2, on="bottom"),
    )


def energy_error(history, lam):
    """Return the relative energy error of the strains at the last instant."""
    mesh = history.mesh
    rows, nodes = rows_in_order(mesh.face_offsets, mesh.face_vertices, mesh.cell_faces)
    cell = cell_of_corner(mesh.cell_offsets)[cell_of_corner(rows)]
    face = np.repeat(mesh.cell_faces, np.diff(rows))
    corners = np.stack(
        [mesh.centroids[cell], mesh.face_centroids[face], mesh.points[nodes], mesh.points[nodes[next_corner(rows)]]], 1
    )
    arms = corners[:, 1:] - corners[:, :1]
    volume = np.abs(np.einsum("ki,ki->k", arms[:, 0], np.cross(arms[:, 1], arms[:, 2]))) / 6.0
    apart, norm = 0.0, 0.0
    far, near = 0.5854101966249685, 0.1381966011250105
    for k in range(4):
        x = np.einsum("j,kji->ki", np.where(np.arange(4) == k, far, near), corners)
        exact = strain(x, float(history.times[-1]), lam)
        missed = exact - strains(Space(mesh), history.displacement[-1])[cell]
        apart, norm = (total + float(0.25 * volume @ density(e, lam)) for total, e in ((apart, missed), (norm, exact)))
    return np.sqrt(apart / norm)


def density(e, lam):
    shear = plane.MU * (2 * (e[:, :3] ** 2).sum(axis=1) + (e[:, 3:] ** 2).sum(axis=1))
    return shear + lam * e[:, :3].sum(axis=1) ** 2
