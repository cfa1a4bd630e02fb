"""Two user-defined stabilisations: their patch test, their orders, and their effect on incompressible bodies.

Let Pi be the projection on linear fields. The stabilisation S(v - Pi v, w - Pi w) is the discrete energy of the
remainders of two fields v and w. A class with one method defines S for each cell K. The scene takes an object of this
class, as in ``vx.Elasticity(..., stabilisation=DRecipe())``. The stiffness, the error budget and the nodal distance of
two runs (`vx.measures.energy_distance`) use this stabilisation.

boundary    S = mu / 2 sum_e (m / |e|) (v_b - v_a).(w_b - w_a), with edges e from a to b, and m the mean of |e|. This is
            mu m / 2 times the integral over the boundary of K of d_s v . d_s w, with the slopes d_s along edges.
            S. Brenner and Sung, Virtual element methods on meshes with small edges or faces (2018); P. Wriggers and
            others, A virtual element method for contact (2016)
D-recipe    S = sum_i max(mu, a_K(Pi phi_i, Pi phi_i)) v_i w_i, with the elastic form a_K of the cell, and the shape
            functions phi_i. L. Beirao da Veiga, F. Dassi and A. Russo, High-order virtual element method on polyhedral
            meshes (2017); L. Mascotto (2018)

On a square the hourglass v = (1, -1, 1, -1) changes by 2 along each of four edges. So the boundary form of v is
mu / 2 * 16 = 8 mu, which equals our default 2 mu sum_i v_i^2. On a square of side h
the diagonal a_K(Pi phi_i, Pi phi_i) is (lam + 3 mu) / 4, because the mean gradient of phi_i is (+-1, +-1) / (2 h). The
diagonal is at most mu if lam <= mu, that is up to Poisson's ratio 1/4. Up to this ratio the D-recipe is therefore half
of our default. For larger ratios the D-recipe grows with lam, and locks; deviatoric=True uses a_K with lam = 0.

    python problems/stabilisations_of_ones_own.py [--picture FILE]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

import manufactured_full_slip as full_slip
import vemcvx as vx
from vemcvx.base.canvas import legend_below, light_grid, new_figure, plain_logarithms
from vemcvx.plots.style import MARKERS, SERIES
from vemcvx.vem import consistent_blocks


@dataclass(frozen=True)
class Boundary(vx.Stabilisation):
    """The squared slopes along the edges of a polygon."""

    factor: float = 0.5

    def form(self, cells, C):
        length = np.linalg.norm(np.roll(cells.corners, -1, axis=1) - cells.corners, axis=2)
        weight = self.factor * C[:, 2, 2, None] * length.mean(axis=1)[:, None] / length
        here = np.eye(length.shape[1])
        step = np.roll(here, 1, axis=1) - here
        return np.einsum("ce,ei,ej->cij", weight, step, step)


@dataclass(frozen=True)
class DRecipe(vx.Stabilisation):
    """The diagonal a_K(Pi phi_i, Pi phi_i), or mu if the diagonal is less."""

    deviatoric: bool = False

    def form(self, cells, C):
        if self.deviatoric:
            C = C - C[:, 0, 1][:, None, None] * np.array([[1, 1, 0], [1, 1, 0], [0, 0, 0]])
        diagonal = np.einsum("ciiaa->cia", consistent_blocks(cells, C))
        n, dim = diagonal.shape[1:]
        weights = np.maximum(C[:, 2, 2, None, None], diagonal)
        return np.einsum("cia,ij,ab->cijab", weights, np.eye(n), np.eye(dim))


VARIANTS = {
    "shear": "shear",
    "unit": "unit",
    "boundary": Boundary(),
    "D-recipe": DRecipe(),
    "D-recipe, deviatoric": DRecipe(deviatoric=True),
}
SIZES = (4, 8, 16)
NEAR = 0.49999


def patch_error(stabilisation, mesh):
    """Return the relative error under linear displacements prescribed on the whole boundary."""
    slope = np.array([[0.3, -0.1], [0.2, 0.4]])
    scene = vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3, stabilisation=stabilisation),
        vx.PrescribedDisplacement(lambda x, t: t * x @ slope.T * 1e-3, on="boundary"),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    exact = 1e-3 * mesh.points @ slope.T
    return float(np.abs(history.displacement[-1] - exact).max() / np.abs(exact).max())


def errors(stabilisation, family, sizes=SIZES, poisson=0.3):
    """Return relative energy errors of Pi u at t = 1 for a block whose contact nodes all slip."""
    lam, scene = full_slip.lame(poisson), full_slip.scene(poisson, scale_load, stabilisation=stabilisation)
    runs = [vx.simulate(scene, full_slip.mesh(n, family), [0.0, 1.0]) for n in sizes]
    exact = partial(exact_strain, lam=lam)
    return np.array([vx.measures.energy_error(run, exact).relative for run in runs])


def scale_load(t):
    """Return the factor of the load at time t, which keeps strains below a thousandth."""
    return 1e-3 * t


def exact_strain(x, t, lam):
    return full_slip.strain(x[:, 0], x[:, 1], scale_load(t), lam)


def picture(found):
    """Draw errors against the size of cells for every stabilisation, at two Poisson's ratios."""
    figure = new_figure(9.0, 4.2)
    axes = figure.subplots(1, 2, sharey=True)
    for ax, poisson in zip(axes, (0.3, NEAR), strict=True):
        for k, name in enumerate(VARIANTS):
            ax.plot(1 / np.array(SIZES), found[name, poisson], f"-{MARKERS[k]}", color=SERIES[k], label=name)
        ax.set(xscale="log", yscale="log", title=f"Poisson's ratio {poisson:g}", xlabel="size of Voronoi cells")
        ax.set_xticks(1 / np.array(SIZES), [f"1/{n}" for n in SIZES])
        ax.minorticks_off()
        plain_logarithms(ax.yaxis)
        light_grid(ax)
    axes[0].set_ylabel("relative error in energy")
    legend_below(axes[0])
    return figure


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", type=Path, help="where to draw the errors (PNG)")
    given, found = parser.parse_args(arguments), {}
    names = f"{'voronoi: errors':<24} {'order':>5} {'hexagons':>9} {f'nu = {NEAR}':>13}"
    print(f"{'stabilisation':<22} {'patch':>8}  {names}")
    patch, h = vx.meshes.voronoi(6), 1 / np.array(SIZES)
    for name, stabilisation in VARIANTS.items():
        own, near = (errors(stabilisation, "voronoi", poisson=poisson) for poisson in (0.3, NEAR))
        found[name, 0.3], found[name, NEAR] = own, near
        slope, other = (vx.measures.orders(h, e).slope for e in (own, errors(stabilisation, "hexagons")))
        said, missed = " ".join(f"{e:.5f}" for e in own), patch_error(stabilisation, patch)
        print(f"{name:<22} {missed:>8.0e}  {said:<24} {slope:>5.2f} {other:>9.2f} {near[1]:>13.4f}")
    if given.picture is not None:
        picture(found).savefig(given.picture, dpi=110)


if __name__ == "__main__":
    main()
