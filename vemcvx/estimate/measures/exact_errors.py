"""Errors against closed forms: what Pi u misses of a known displacement.

    energy    ( sum_K int_K C (eps(u) - eps(Pi u_h)) : (eps(u) - eps(Pi u_h)) dx )^(1/2)
    L2        ( sum_K int_K |u - Pi u_h|^2 dx )^(1/2)

by quadrature of degree 5; Pi as in :mod:`vemcvx.vem.projection`. Under (3.28) of the paper the first is O(h + k).

Strains of closed forms are no polynomials, and a rule of low degree hides what is to be measured: at the centroids of
squares the strains of the numerical answer superconverge. So Radon's seven points are taken on every triangle of a
cell.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints, totals
from vemcvx.effects import data
from vemcvx.estimate.measures.convex_parts import convex_pieces
from vemcvx.estimate.measures.field import Field, Measured, field_of, measured
from vemcvx.meshes.interpolation import projected_values
from vemcvx.meshes.polygons.triangles import RADON_POINTS, RADON_WEIGHTS, fans, places
from vemcvx.results.results import Results
from vemcvx.vem import Space, stresses


def energy_error(history: Results | Field, strain: data.Datum, step: int = -1) -> Measured:
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
    x, weights, owner = _cell_rule(field.space)
    exact = data.tensor(strain, x, field.time, "energy_error: strain (e_xx, e_yy, 2 e_xy)")
    moduli = field.moduli[:, owner]
    missed = exact - field.strain[owner]
    missed, exact = (np.sum(e * stresses(moduli, e), axis=1) for e in (missed, exact))
    return measured(totals(owner, weights * missed, field.mesh.n_cells), float(weights @ exact))


def l2_error(history: Results | Field, displacement: data.Datum, step: int = -1) -> Measured:
    """Error of Pi u against a known displacement, in L2.

    Parameters
    ----------
    history, step : as of `energy_error`
        Which says what is raised, too.
    displacement : callable (x, t) -> (m, 2)
        At points x (m, 2) and the instant t of the step.

    Returns
    -------
    Measured
        In length squared; its reference is the L2 norm of the closed form.
    """
    field = field_of(history, step, "l2_error")
    x, weights, owner = _cell_rule(field.space)
    exact = data.vector(displacement, x, field.time, "l2_error: displacement")
    missed = exact - projected_values(field.mesh, owner, x) @ field.displacement
    missed, exact = (np.sum(u**2, axis=1) for u in (missed, exact))
    return measured(totals(owner, weights * missed, field.mesh.n_cells), float(weights @ exact))


def _cell_rule(space: Space) -> tuple[Floats, Floats, Ints]:
    """Points (q, 2), weights (q,) that add up to the areas, and the cell (q,) of each point."""
    pieces = convex_pieces(space)
    triangles = fans(pieces.corners, pieces.owner)
    points = places(triangles.corners, RADON_POINTS).reshape(-1, 2)
    weights = triangles.areas[:, None] * RADON_WEIGHTS
    return points, weights.ravel(), np.repeat(triangles.owner, len(RADON_WEIGHTS))
