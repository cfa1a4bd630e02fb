"""Errors against closed forms: what Pi u misses of a known displacement.

    energy    ( sum_K int_K C (eps(u) - eps(Pi u_h)) : (eps(u) - eps(Pi u_h)) dx )^(1/2)
    L2        ( sum_K int_K |u - Pi u_h|^2 dx )^(1/2)

by quadrature of degree 5; Pi as in :mod:`vemcvx.vem.projection`. Under (3.28) of the paper the first is O(h + k).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vemcvx.effects import data
from vemcvx.history import History
from vemcvx.measures.cell_rule import cell_rule
from vemcvx.measures.field import Field, field_of
from vemcvx.measures.measured import Measured, measured
from vemcvx.vem import stresses
from vemcvx.vem.projection import area_gradients, boundary_weights

Floats = NDArray[np.float64]


def energy_error(history: History | Field, strain: data.Datum, step: int = -1) -> Measured:
    """Error of Pi u against a known strain, in the energy norm.

    Parameters
    ----------
    history : History or Field
    strain : callable (x, t) -> (m, 3)
        e_xx, e_yy and 2 e_xy at points x (m, 2) and the instant t of the step.
    step : int
        A stored step; negative ones count from the end.

    Returns
    -------
    Measured
        Its reference is the energy norm of the closed form.

    Raises
    ------
    SceneError
        That step was not stored, or the strain is ill-shaped or not finite.
    HistoryError
        `history` is neither a history nor a field.
    """
    field = field_of(history, step, "energy_error")
    x, weights, owner = cell_rule(field.space)
    exact = data.tensor(strain, x, field.time, "energy_error: strain (e_xx, e_yy, 2 e_xy)")
    moduli = field.moduli[:, owner]
    missed = exact - field.strain[owner]
    squares = weights * np.sum(missed * stresses(moduli, missed), axis=1)
    reference = float(weights @ np.sum(exact * stresses(moduli, exact), axis=1))
    return measured(np.bincount(owner, squares, field.mesh.n_cells).astype(float), reference)


def l2_error(history: History | Field, displacement: data.Datum, step: int = -1) -> Measured:
    """Error of Pi u against a known displacement, in L2.

    Parameters
    ----------
    history : History or Field
    displacement : callable (x, t) -> (m, 2)
        At points x (m, 2) and the instant t of the step.
    step : int
        A stored step; negative ones count from the end.

    Returns
    -------
    Measured
        In length squared; its reference is the L2 norm of the closed form.

    Raises
    ------
    SceneError
        That step was not stored, or the displacement is ill-shaped or not finite.
    HistoryError
        `history` is neither a history nor a field.
    """
    field = field_of(history, step, "l2_error")
    x, weights, owner = cell_rule(field.space)
    exact = data.vector(displacement, x, field.time, "l2_error: displacement")
    centre, value, gradient = _linear(field)
    missed = exact - value[owner] - np.einsum("qab,qb->qa", gradient[owner], x - centre[owner])
    squares = weights * np.sum(missed**2, axis=1)
    return measured(
        np.bincount(owner, squares, field.mesh.n_cells).astype(float), float(weights @ np.sum(exact**2, axis=1))
    )


def _linear(field: Field) -> tuple[Floats, Floats, Floats]:
    """Pi u(x) = value + gradient (x - centre) on every cell: (n_cells, 2), (n_cells, 2) and (n_cells, 2, 2)."""
    n = field.mesh.n_cells
    centre, value, gradient = np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 2, 2))
    for group in field.space.groups:
        corners, u = group.corners, field.displacement[group.nodes]
        areas, g = area_gradients(corners)
        w = boundary_weights(corners)
        centre[group.cells] = group.points[group.nodes[:, 0]] + np.einsum("ci,cia->ca", w, corners)
        value[group.cells] = np.einsum("ci,cia->ca", w, u)
        gradient[group.cells] = np.matmul((u - u[:, :1]).transpose(0, 2, 1), g) / areas[:, None, None]
    return centre, value, gradient
