"""Materials: nearly incompressible materials, and stiff cells beside soft cells."""

from __future__ import annotations

import numpy as np

import manufactured_full_slip as full_slip
import vemcvx as vx
from hard.case import ANSWER, REFUSAL, WARNING, Case, Setting
from hard.ground import on, voronoi
from vemcvx.vem import Space, strains

MESH = 12
NEAR = 0.4999
"""The largest Poisson's ratio in `CASES` at which answers are certified to 1e-8."""


def strain_error(history, poisson):
    """Return the relative error of the strains at centroids, in the norm (sum of cell area times |eps|^2)^(1/2)."""
    mesh = history.mesh
    x, y = mesh.centroids.T
    exact = full_slip.strain(x, y, 1.0, full_slip.lame(poisson))
    apart = (strains(Space(mesh), history.displacement[-1]) - exact) ** 2 @ [1.0, 1.0, 0.5]
    return np.sqrt((mesh.areas @ apart) / (mesh.areas @ (exact**2 @ [1.0, 1.0, 0.5])))


def compressible():
    scene = full_slip.scene(0.3)
    return strain_error(vx.simulate(scene, full_slip.mesh(MESH), [0.0, 1.0]), 0.3)


def incompressible(poisson):
    def does_not_lock(setting, history):
        error, before = strain_error(history, poisson), compressible()
        return "" if error <= 1.5 * before else f"error {error:.1e}, {before:.1e} at nu = .3: it locks"

    def make():
        return Setting(full_slip.scene(poisson), full_slip.mesh(MESH), np.linspace(0, 1, 3))

    return Case(f"nu = {poisson!r}, polygons, full slip", make, holds=does_not_lock, beyond=poisson > NEAR)


def soft_layer(x):
    return np.where(x[:, 1] < 0.1, 2e-6, 200.0)


def random_moduli(mesh):
    return 200.0 * 10.0 ** np.random.default_rng(1).uniform(-4, 4, mesh.n_cells)


VORONOI = voronoi(MESH)
CASES = (
    *(incompressible(poisson) for poisson in (0.4999, 0.499999, 0.49999999)),
    Case("nu = .49999999, stick and slip", lambda: on(VORONOI, poisson=0.49999999), ANSWER, beyond=True),
    Case("nu = .4999 on triangles", lambda: on(vx.meshes.triangles(MESH), poisson=0.4999), WARNING, "lock near 1/2"),
    Case("nu = .5 in plane strain", lambda: on(VORONOI, poisson=0.5), REFUSAL, "must be > -1 and < 0.5"),
    Case("nu = .5 in plane stress", lambda: on(VORONOI, poisson=0.5, plane="stress")),
    Case("nu = -1", lambda: on(VORONOI, poisson=-1.0), REFUSAL, "must be > -1"),
    Case("nu = -.999", lambda: on(VORONOI, poisson=-0.999)),
    Case("contrast 1e8, cell by cell", lambda: on(VORONOI, young=random_moduli(VORONOI))),
    Case("a layer at the contact, softer by 1e8", lambda: on(VORONOI, young=soft_layer)),
    Case("E = 0 in one cell", lambda: on(VORONOI, young=np.arange(VORONOI.n_cells)), REFUSAL, "must be > 0"),
)
