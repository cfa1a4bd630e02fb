"""Stabilisations S_K: energies of the remainder u - Pi u on a cell K, for a displacement u with the projection Pi u.

For vertex values, S_K has a symmetric matrix S that is positive definite on remainders. The local matrix of the cell
has the term (I - Pi)' S (I - Pi). The patch test and the error bounds hold for any S_K. The method is stable if S_K is
comparable to the true energy of u - Pi u, (2.9) of the paper named in :mod:`vemcvx` (docs/theory/virtual_elements.md).
For cells of diameter h_K, "shear" is S = 2 mu h_K^(dim - 2) I, and "unit" is S = h_K^(dim - 2) I, as in the paper.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from vemcvx.base.arrays import ROUNDING, Floats, as_real_array, call_function, finite
from vemcvx.base.errors import SceneError
from vemcvx.vem.projection import CellGroup
from vemcvx.vem.space import Space

NAMES = ("shear", "unit")


class Stabilisation(ABC):
    """A base class for a user's stabilisation S_K: ``vx.Elasticity(..., stabilisation=MyStabilisation())``.

    A subclass defines `form`. Make the subclass a frozen dataclass, so that stabilisations can be compared.

    Examples
    --------
    In the plane, S = mu I with mu = C[:, 2, 2] is half of "shear". See also problems/stabilisations_of_ones_own.py.

    >>> class HalfOfOurs(vx.Stabilisation):
    ...     def form(self, cells, C):
    ...         return C[:, 2, 2, None, None] * np.eye(cells.nodes.shape[1])
    """

    @abstractmethod
    def form(self, cells: CellGroup, C: Floats) -> Floats:
        """Return S for cells with equally many vertices.

        Parameters
        ----------
        cells : CellGroup
            c cells with n vertices. `cells.corners` (c, n, dim) has coordinates relative to the first vertex of each
            cell. `cells.vertex_values()` returns the matrices (c, n, n) of Pi for vertex values. For vertex values v_i,
            let grad Pi v = sum_i v_i G_i'. Then `cells.gradients()` returns the measures |K| (c,) and the vectors
            |K| G_i (c, n, dim). See also :func:`vemcvx.vem.consistent_blocks`.
        C : (c, 3, 3) array, in space (c, 6, 6)
            Elastic matrices, components as in :mod:`vemcvx.vem.tensors`, force per area.

        Returns
        -------
        (c, n, n) array, or (c, n, n, dim, dim)
            The symmetric S, force per area times length^(dim - 2). The first shape has one matrix for all components.
            Entry (K, i, j, a, b) of the second shape couples component a of vertex i with component b of vertex j.
        """

    def describe(self) -> str:
        """Return the name of the stabilisation in the description of a scene."""
        return type(self).__name__


@dataclass(frozen=True, eq=False)
class VertexWeights(Stabilisation):
    """The stabilisation S = tau h_K^(dim - 2) I, with moduli tau (n_cells,)."""

    tau: Annotated[Floats, "cells", "force/area"]

    def form(self, cells: CellGroup, C: Floats) -> Floats:
        """Return S, (c, n, n)."""
        return (self.tau[cells.cells] * cells.stabilised_size)[:, None, None] * np.eye(cells.nodes.shape[1])


def stabilisation_of(given: str | Stabilisation, shear: Floats) -> Stabilisation:
    """Return the stabilisation of a name, or a user's stabilisation unchanged."""
    if isinstance(given, Stabilisation):
        return given
    if given not in NAMES:
        raise SceneError(
            f"stiffness: found stabilisation {given!r}; there are 'shear' and 'unit', and any vx.Stabilisation."
        )
    return VertexWeights(2.0 * shear if given == "shear" else np.sign(shear))


def in_components(form: Floats, dim: int) -> Floats:
    """Return S as an array (c, n, n, dim, dim)."""
    return form if form.ndim == 5 else form[..., None, None] * np.eye(dim)


def add_stabilisation(blocks: Floats, cells: CellGroup, stabilisation: Stabilisation, C: Floats) -> None:
    """Add (I - Pi)' S (I - Pi) to local matrices; raise SceneError for invalid S."""
    if cells.simplices:
        return
    S = _check_form(stabilisation, cells, C, blocks.shape[-1])
    missed = np.eye(S.shape[1]) - cells.vertex_values()
    stable = np.einsum("cki,cklab,clj->cijab", missed, S, missed, optimize=True)
    stable = 0.5 * (stable + stable.transpose(0, 2, 1, 4, 3))
    _require_positive(stable, stabilisation.describe())
    blocks += stable


def _check_form(stabilisation: Stabilisation, cells: CellGroup, C: Floats, dim: int) -> Floats:
    name, (count, n) = stabilisation.describe(), cells.nodes.shape
    failed = f"{name}: its form failed when called with cells of {n} vertices"
    raw = call_function(stabilisation.form, (cells, C), failed, "return a matrix S for every cell")
    S = as_real_array(raw, f"{name}: form", "a matrix S for every cell")
    if S.shape not in ((count, n, n), (count, n, n, dim, dim)):
        raise SceneError(
            f"{name}: found a form of shape {S.shape} for {count} cells with {n} vertices; wanted {(count, n, n)}, the "
            f"same for each component, or {(count, n, n, dim, dim)}."
        )
    S = in_components(finite(S, f"{name}: form"), dim)
    skew = np.abs(S - S.transpose(0, 2, 1, 4, 3)).max()
    if skew > ROUNDING * np.abs(S).max():
        raise SceneError(
            f"{name}: found a form of a cell with {n} vertices that differs from its transpose by {skew:.3g}; it must "
            "be symmetric."
        )
    return S


def _require_positive(stable: Floats, name: str) -> None:
    count, n, _, dim, _ = stable.shape
    values = np.linalg.eigvalsh(stable.transpose(0, 1, 3, 2, 4).reshape(count, n * dim, n * dim))
    largest = np.abs(values).max(axis=1)
    # The lowest dim (dim + 1) eigenvalues are zero, for linear displacements.
    least, first = values[:, 0], values[:, dim * (dim + 1)]
    if ((least < -ROUNDING * largest) | (first <= ROUNDING * largest)).any():
        raise SceneError(
            f"{name}: found a cell with {n} vertices where some v - Pi v has no positive energy. Every motion v that "
            "is not linear needs positive energy (2.9). For example, use a fraction of mu times the identity."
        )


def products_of_remainder(Pi: Floats) -> Floats:
    """Return (I - Pi)'(I - Pi)."""
    missed = np.eye(Pi.shape[1]) - Pi
    product: Floats = np.matmul(missed.transpose(0, 2, 1), missed)
    # Rounding makes the product slightly unsymmetric.
    return 0.5 * (product + product.transpose(0, 2, 1))


def remainder_energies(space: Space, stabilisation: Stabilisation, C: Floats, u: Floats) -> Floats:
    """Return the energies S_K(u - Pi u, u - Pi u), (n_cells,)."""
    energies = np.zeros(space.mesh.n_cells)
    for group in space.groups:
        for chunk in () if group.simplices else group.chunks():
            about = u[chunk.nodes] - u[chunk.nodes[:, :1]]
            missed = about - np.matmul(chunk.vertex_values(), about)
            S = in_components(stabilisation.form(chunk, C[chunk.cells]), space.dim)
            energies[chunk.cells] = np.einsum("cia,cijab,cjb->c", missed, S, missed, optimize=True)
    return np.where(np.abs(C).max(axis=(1, 2)) > 0.0, energies, 0.0)
