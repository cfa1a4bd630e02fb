"""Stabilisations: S_K of (3.13), the energy of what the projection Pi misses.

    a_K^h(u, v) = (C eps(Pi u), eps(Pi v))_K + S_K(u - Pi u, v - Pi v)

The first part is exact as soon as one of the two is linear, and since (I - Pi) p = 0 for linear p the second leaves
that alone, whatever S_K is: (2.8), and with it the patch test, hold by construction. What S_K has to bring is (2.9),
alpha_* a_K <= a_K^h <= alpha^* a_K with constants that do not depend on K: an energy of the size of the true one for
what Pi misses, no less for any motion of the vertices. (Of the size of its part in shear: with lam in it the method
would lock. So alpha_* falls with nu, on a square as 6 mu / (lam + 3 mu): problems/stabilisation_spectrum.py.) In vertex
values that is a matrix S, symmetric and positive definite on the range of I - Pi, and the local matrix gains

    (I - Pi)' S (I - Pi).

Two are here by name: S = tau h_K^(dim - 2) I, tau = 2 mu ("shear") or 1 ("unit", the letter of the paper)
(:mod:`vemcvx.vem.elasticity`). Every other one is a class of its own, :class:`Stabilisation`; the stiffness, the error
budget and the nodal distance ask it for S, so that they measure in the same a^h. Bounds of errors
(:mod:`vemcvx.bound`) are in a itself, the energy of the continuum, and need no S_K: they hold for the answer of any.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from vemcvx.base.arrays import ROUNDING, Bools, Floats, as_real_array, called
from vemcvx.base.errors import SceneError
from vemcvx.vem.projection import CellGroup
from vemcvx.vem.space import Space

NAMED = ("shear", "unit")


class Stabilisation(ABC):
    """A stabilisation S_K of one's own: ``vx.Elasticity(..., stabilisation=MyStabilisation())``.

    A subclass says `form`; what it is made of beside is its own, and a frozen dataclass compares, prints and pickles
    well. It knows no mesh: cells come in groups of equally many vertices, and translates of each other with the same
    moduli may be asked for once, for all of them.

    Examples
    --------
    In the plane, where C[:, 2, 2] is mu (in space that is lam + 2 mu, and C[:, 3, 3] is mu): mu for every component at
    every vertex, half of ours; problems/stabilisations_of_ones_own.py has others.

    >>> class HalfOfOurs(vx.Stabilisation):
    ...     def form(self, cells, C):
    ...         return C[:, 2, 2, None, None] * np.eye(cells.nodes.shape[1])
    """

    @abstractmethod
    def form(self, cells: CellGroup, C: Floats) -> Floats:
        """S of cells with equally many vertices.

        Parameters
        ----------
        cells : CellGroup
            c cells with n vertices: `cells.corners` (c, n, dim) coordinates relative to the first vertex of each,
            `cells.vertex_values()` (c, n, n) the projection Pi in vertex values, `cells.gradients()` measures (c,) and
            |K| G_i (c, n, dim) with grad Pi v = sum_i v_i (x) G_i. For the consistent part of a_K^h see
            :func:`vemcvx.vem.consistent_blocks`.
        C : (c, 3, 3) array, in space (c, 6, 6)
            Stresses from strains, components as in :mod:`vemcvx.vem.elasticity`, force per area.

        Returns
        -------
        (c, n, n) array, or (c, n, n, dim, dim)
            S, symmetric, in force per area times h^(dim - 2): one for each component of displacements alike, or with
            entry (K, i, j, a, b) between component a of vertex i and b of vertex j. It is applied to v - Pi v.
        """

    def describe(self) -> str:
        """The name with which scenes describe themselves."""
        return type(self).__name__


@dataclass(frozen=True, eq=False)
class VertexWeights(Stabilisation):
    """S = tau h_K^(dim - 2) I.

    Attributes
    ----------
    tau : (n_cells,)
        The modulus by which the stiffness weighs what Pi misses.
    """

    tau: Annotated[Floats, "cells", "force/area"]

    def form(self, cells: CellGroup, C: Floats) -> Floats:
        """S, (c, n, n)."""
        return (self.tau[cells.cells] * cells.stabilised_size)[:, None, None] * np.eye(cells.nodes.shape[1])


@dataclass(frozen=True, eq=False)
class InRegions(Stabilisation):
    """Stabilisations of several materials, each on the cells (n_cells,) that it fills."""

    regions: tuple[tuple[Bools, Stabilisation], ...]

    def form(self, cells: CellGroup, C: Floats) -> Floats:
        """S, (c, n, n, dim, dim)."""
        dim, n = cells.corners.shape[2], cells.nodes.shape[1]
        whole = np.zeros((len(cells.cells), n, n, dim, dim))
        for filled, own in self.regions:
            here = np.flatnonzero(filled[cells.cells])
            if len(here):
                whole[here] = in_components(own.form(cells.part(here), C[here]), dim)
        return whole


def stabilisation_of(given: str | Stabilisation, shear: Floats) -> Stabilisation:
    """The stabilisation that is named, or given, on cells of the moduli of shear mu (n_cells,), zero where empty.

    SceneError where it is neither.
    """
    if isinstance(given, Stabilisation):
        return given
    if given not in NAMED:
        raise SceneError(
            f"stiffness: found stabilisation {given!r}; there are 'shear' and 'unit', and any vx.Stabilisation."
        )
    return VertexWeights(2.0 * shear if given == "shear" else np.sign(shear))


def in_components(form: Floats, dim: int) -> Floats:
    """S (c, n, n, dim, dim) of one for each component alike, or of what couples them already."""
    return form if form.ndim == 5 else form[..., None, None] * np.eye(dim)


def add_stabilisation(blocks: Floats, cells: CellGroup, stabilisation: Stabilisation, C: Floats) -> None:
    """Add (I - Pi)' S (I - Pi) of a stabilisation of one's own to local matrices (c, n, n, dim, dim).

    SceneError where its form is no symmetric matrix of that size, or not positive on all that Pi misses.
    """
    if cells.simplices:
        return
    S = _checked(stabilisation, cells, C, blocks.shape[-1])
    missed = np.eye(S.shape[1]) - cells.vertex_values()
    stable = np.einsum("cki,cklab,clj->cijab", missed, S, missed, optimize=True)
    stable = 0.5 * (stable + stable.transpose(0, 2, 1, 4, 3))
    _require_positive(stable, stabilisation.describe())
    blocks += stable


def _checked(stabilisation: Stabilisation, cells: CellGroup, C: Floats, dim: int) -> Floats:
    """S (c, n, n, dim, dim), as it must be."""
    name, (count, n) = stabilisation.describe(), cells.nodes.shape
    failed = f"{name}: its form failed when called with cells of {n} vertices"
    raw = called(stabilisation.form, (cells, C), failed, "return a matrix S for every cell")
    S = as_real_array(raw, f"{name}: form", "a matrix S for every cell")
    if S.shape not in ((count, n, n), (count, n, n, dim, dim)):
        raise SceneError(
            f"{name}: found a form of shape {S.shape} for {count} cells with {n} vertices; wanted {(count, n, n)}, the "
            f"same for each component, or {(count, n, n, dim, dim)}."
        )
    if not np.isfinite(S).all():
        raise SceneError(
            f"{name}: found NaN or infinity in the form of a cell with {n} vertices; wanted finite numbers."
        )
    S = in_components(S, dim)
    skew = np.abs(S - S.transpose(0, 2, 1, 4, 3)).max()
    if skew > ROUNDING * np.abs(S).max():
        raise SceneError(
            f"{name}: found a form of a cell with {n} vertices that differs from its transpose by {skew:.3g}; energies "
            "want a symmetric one."
        )
    return S


def _require_positive(stable: Floats, name: str) -> None:
    """Raise SceneError unless only linear displacements have no energy in (c, n, n, dim, dim)."""
    count, n, _, dim, _ = stable.shape
    values = np.linalg.eigvalsh(stable.transpose(0, 1, 3, 2, 4).reshape(count, n * dim, n * dim))
    largest = np.abs(values).max(axis=1)
    # Linear displacements, dim (dim + 1) of them, are what Pi keeps; eigenvalues ascend.
    least, first = values[:, 0], values[:, dim * (dim + 1)]
    if (least < -ROUNDING * largest).any():
        raise SceneError(
            f"{name}: found a cell with {n} vertices where what Pi misses has the energy {least.min():.3g}; every "
            "motion that is not linear must have a positive one."
        )
    if (first <= ROUNDING * largest).any():
        raise SceneError(
            f"{name}: found a cell with {n} vertices where some motion that Pi misses has no energy; (2.9) wants one "
            "for every motion that is not linear, such as a part of mu times the identity."
        )


def missed_products(Pi: Floats) -> Floats:
    """(I - Pi)'(I - Pi), (c, n, n), of the projection of vertex values: scalar products of what it misses."""
    missed = np.eye(Pi.shape[1]) - Pi
    product: Floats = np.matmul(missed.transpose(0, 2, 1), missed)
    # A matrix product may sum (i, j) and (j, i) in different orders.
    return 0.5 * (product + product.transpose(0, 2, 1))


def missed_energies(space: Space, stabilisation: Stabilisation, C: Floats, u: Floats) -> Floats:
    """S_K(u - Pi u, u - Pi u) of each cell, (n_cells,), of nodal displacements (n_nodes, dim).

    C (n_cells, components, components) is zero on cells without a material, which have none.
    """
    energies = np.zeros(space.mesh.n_cells)
    for group in space.groups:
        for chunk in () if group.simplices else group.chunks():
            about = u[chunk.nodes] - u[chunk.nodes[:, :1]]
            missed = about - np.matmul(chunk.vertex_values(), about)
            if isinstance(stabilisation, VertexWeights):
                weights = stabilisation.tau[chunk.cells] * chunk.stabilised_size
                energies[chunk.cells] = weights * np.sum(missed**2, axis=(1, 2))
            else:
                S = in_components(stabilisation.form(chunk, C[chunk.cells]), space.dim)
                energies[chunk.cells] = np.einsum("cia,cijab,cjb->c", missed, S, missed, optimize=True)
    return np.where(np.abs(C).max(axis=(1, 2)) > 0.0, energies, 0.0)
