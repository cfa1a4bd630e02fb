"""What contact and friction are to a System: norm terms over the free unknowns, dragged ones, limits, Coulomb's law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.program.limits import Limits
from vemcvx.program.system import DraggedTerms, Norms
from vemcvx.scene.freedom import on_free
from vemcvx.scene.obstacles import Obstacles, pressing
from vemcvx.scene.supports import Supports
from vemcvx.scene.terms import Terms


@dataclass(frozen=True)
class FrictionLaw:
    """How the weights of all terms follow the forces of the limits."""

    weights: Callable[[float, Floats], Floats]
    """(t, forces (r,)) -> (m,)"""
    slope: Callable[[float, Floats], sp.csr_matrix] | None
    """(t, forces (r,)) -> (m, r), the derivative of weights that are piecewise affine; None if they are not"""


def limits(obstacles: Obstacles, supports: Supports) -> Limits | None:
    """The limits of obstacles, over the free unknowns."""
    nodes, points = obstacles.nodes, supports.points
    if len(nodes) == 0:
        return None

    def place(j: int) -> str:
        return f"node {nodes[j]} at {tuple(float(x) for x in np.round(points[nodes[j]], 12))}"

    return Limits(on_free(obstacles.rows, supports), obstacles.gap, obstacles.compliance, place)


def norm_terms(terms: Terms, law: FrictionLaw | None, supports: Supports) -> Norms | None:
    """The terms that some unknown moves."""
    m, nodes, points = terms.acting, terms.nodes, supports.points
    if m == 0:
        return None
    under, bias = None if law is None else law.weights, terms.bias
    slope = None if law is None else law.slope

    def place(i: int) -> str:
        return f"node {nodes[i]} at {tuple(float(x) for x in np.round(points[nodes[i]], 12))}"

    block = terms.rows.shape[0] // len(nodes)
    return Norms(
        B=on_free(acting_rows(terms), supports),
        w=lambda t: terms.weights(t)[:m],
        block=block,
        places=place,
        law=None if under is None else lambda t, p: under(t, p)[:m],
        bias=None if bias is None else lambda t: bias(t)[: m * block],
        slope=None if slope is None else lambda t, p: slope(t, p)[:m],
    )


def dragged_terms(terms: Terms, law: FrictionLaw | None, supports: Supports) -> DraggedTerms | None:
    """The terms that none does."""
    m, q = terms.acting, len(terms.nodes) - terms.acting
    if q == 0:
        return None
    block, bias = terms.rows.shape[0] // len(terms.nodes), terms.bias
    rows = terms.rows[m * block :]
    return DraggedTerms(
        lambda t: rows @ supports.motion(t),
        lambda t, p: (terms.weights(t) if law is None else law.weights(t, p))[m:],
        q,
        block,
        None if bias is None else lambda t: bias(t)[m * block :],
    )


def acting_rows(terms: Terms) -> sp.csr_matrix:
    """B^ of the terms that some unknown moves."""
    block = terms.rows.shape[0] // max(len(terms.nodes), 1)
    return terms.rows[: terms.acting * block]


def friction_law(terms: Terms, obstacles: Obstacles, ends: sp.csr_matrix, supports: Supports) -> FrictionLaw | None:
    """Weights under the forces of the limits, if some depend on them."""
    pressed = terms.pressed
    if pressed is None or len(terms.nodes) == 0:
        return None
    own = np.split(np.arange(ends.shape[0]), np.cumsum([len(f.nodes) for f in terms.frictions])[:-1])
    press: list[sp.csr_matrix] = [
        sp.csr_matrix((len(rows), len(obstacles.nodes)))
        if f.law is None
        else pressing(obstacles, f, ends[rows], supports)
        for f, rows in zip(terms.frictions, own, strict=True)
    ]

    def law(t: float, p: Floats) -> Floats:
        return pressed(t, [M @ p for M in press])

    slope = terms.slope
    return FrictionLaw(law, None if slope is None else lambda t, p: slope(t, press, p))
