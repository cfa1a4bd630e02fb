"""The norm terms of friction over all nodal values, and laws whose weights follow the answer."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.effects import Friction
from vemcvx.errors import SceneError, SceneWarning
from vemcvx.program.terms import DraggedTerms, Norms
from vemcvx.scene.freedom import Moving, along, freedom, merged, normal_is_free, on_free
from vemcvx.scene.jumps import Jumps, ends_of_groups, lengths_of, summing
from vemcvx.scene.supports import PARALLEL, Supports
from vemcvx.vem import tangents_of

# Friction whose weights follow the answer: the forces of the limits, and the slip.


@dataclass(frozen=True)
class FrictionLaw:
    """How the weights of all terms follow the forces p (r,) of the limits, and slips (m,)."""

    frictions: Sequence[Friction]
    gather: sp.csr_matrix
    """(m, rows) which rows of all frictions add up to a term"""
    press: sp.csr_matrix
    """(rows, r) which limits press on which rows"""

    def weights(self, t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
        """Weights (m,) under the forces of the limits, after slips before the step and in it."""
        of_rows = zip(self._of_rows(self.press @ p), self._slips(past), self._slips(slip), strict=True)
        return self._added([_weights_under(f, t, *under) for f, under in zip(self.frictions, of_rows, strict=True)])

    def part(self, terms: slice) -> Callable[[float, Floats, Floats, Floats], Floats]:
        """The weights of some of the terms, which follow the slips of the same."""

        def weights(t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
            every = np.zeros((2, self.gather.shape[0]))
            every[:, terms] = past, slip
            return self.weights(t, p, every[0], every[1])[terms]

        return weights

    @property
    def has_slope(self) -> bool:
        """Whether weights are piecewise affine in the forces, with a derivative that is known."""
        return all(f.has_slope for f in self.frictions if f.dependent)

    def slope(self, t: float, p: Floats, past: Floats) -> sp.csr_matrix:
        """That derivative (m, r)."""
        press, of_rows = self.press, zip(self._of_rows(self.press @ p), self._slips(past), strict=True)
        steep = np.concatenate([_slope_under(f, t, *under) for f, under in zip(self.frictions, of_rows, strict=True)])
        entries = np.repeat(steep, np.diff(press.indptr)) * press.data
        return sp.csr_matrix(self.gather @ sp.csr_matrix((entries, press.indices, press.indptr), shape=press.shape))

    @property
    def remembers(self) -> bool:
        """Whether some depend on slip."""
        return any(f.slip_law is not None for f in self.frictions)

    @property
    def softening(self) -> Floats | None:
        """How fast weights (m,) fall with the slip of the step at most; None where forces count, or nobody knows."""
        laws = [f.slip_law for f in self.frictions]
        if any(f.law is not None for f in self.frictions) or any(law and law.softening is None for law in laws):
            return None
        pairs = zip(self.frictions, laws, strict=True)
        each = [np.zeros(len(f.nodes)) if law is None else law.rate(f.subject, f.nodes) for f, law in pairs]
        return self._added(each)

    def _slips(self, values: Floats) -> list[Floats]:
        """Slips (m,) of terms for the rows of every friction, zero where there is no term; none if no law sees them."""
        if not self.remembers:
            return [np.zeros(0)] * len(self.frictions)
        return self._of_rows(self.gather.T @ values)

    def _of_rows(self, values: Floats) -> list[Floats]:
        """Values (rows,) friction by friction."""
        return np.split(values, np.cumsum([len(f.nodes) for f in self.frictions])[:-1])

    def _added(self, parts: Sequence[Floats]) -> Floats:
        total: Floats = self.gather @ np.concatenate(parts)
        return total


def _weights_under(friction: Friction, t: float, forces: Floats, before: Floats, slip: Floats) -> Floats:
    """Weights (rows,) under their normal forces, after slips, which laws may see, before the step and in it."""
    w = friction.weights(t)
    if friction.law is not None:
        w = w + friction.law(t, forces)
    if friction.slip_law is not None:
        w = w + friction.slip_law.added(friction.subject, friction.nodes, t, forces, (before, slip))
    return w


def _slope_under(friction: Friction, t: float, forces: Floats, before: Floats) -> Floats:
    """Their derivatives (rows,) by these forces; zero if they are not known."""
    slope = np.zeros(len(forces)) if friction.slope is None else friction.slope(t, forces)
    if friction.slip_law is not None:
        slope = slope + friction.slip_law.slope_at(friction.subject, friction.nodes, t, forces, before)
    return slope


# The norm terms of friction, over all nodal values, and what a System knows of them.
#
# A friction effect brings one row a node and distinct normal; rows of one node with one normal are one term, whose
# weights add up and whose length is that of all their edges; where they rub on grounds that move differently, each is
# a term of its own. Over u the matrix of the terms is B^ (orthonormal tangents); over the free unknowns it is B = B^
# P. Terms that no free unknown can move come last: they rub where supports drag their nodes along, and are shown
# where contact presses them; held otherwise, they are dropped.


@dataclass(frozen=True, kw_only=True)
class Terms:
    """The norm terms of a posed scene, over all nodal values."""

    rows: sp.csr_matrix
    """(m * (dim - 1), n_u) B^, orthonormal tangents"""
    jumps: Jumps
    tangents: Floats
    """(m, dim - 1, dim)"""
    lengths: Floats
    """(m,) integrals of the nodal basis functions over the edges with friction: of all parts that meet in a term"""
    directed: Bools
    """(m,) which are along directions that their friction gives"""
    frictions: Sequence[Friction]
    gather: sp.csr_matrix
    """(m, rows) which rows of all frictions, one after the other, add up to a term"""
    sign: Floats
    """(rows,) 1 where the tangent of a row is that of its term, else -1"""
    acting: int = 0
    """how many of the m, the first, some free unknown moves"""
    dragged: Bools | None = None
    """(m,) which of them supports move along the boundary, in some direction at least"""
    ends: sp.csr_matrix
    """(m, e) the ends of edges of each: see :mod:`vemcvx.scene.jumps`"""
    names: Ints
    """(e, 2) of each end its node, and the other node of its edge"""
    ground: Callable[[float], Floats] | None = None
    """t -> (m * (dim - 1),), how far the ground has moved along the tangents since the first instant; None if still"""

    @property
    def nodes(self) -> Ints:
        """(m,) the nodes on which friction acts; on their partners it acts the other way."""
        return self.jumps.nodes

    def weights(self, t: float) -> Floats:
        """Weights (m,) at the instant `t`: those of their rows added up, without what follows the answer."""
        total: Floats = self.gather @ np.concatenate([np.zeros(0), *(f.weights(t) for f in self.frictions)])
        return total

    @property
    def one_way(self) -> bool:
        """Whether some cost more one way than the other."""
        return any(f.bias is not None for f in self.frictions)

    def bias(self, t: float) -> Floats:
        """The bias (m,) at the instant `t`, along the tangent of each term."""
        each = [np.zeros(len(f.nodes)) if f.bias is None else f.bias(t) for f in self.frictions]
        total: Floats = self.gather @ (self.sign * np.concatenate(each))
        return total


def friction_terms(
    frictions: Sequence[Friction], owns: tuple[sp.csr_matrix, Ints], supports: Supports, times: Sequence[float] = ()
) -> Terms:
    """The terms of all frictions where something can slip or is dragged; equal node, normal and ground make one term.

    `owns` are the ends of edges that their rows own, numbered as those of obstacles are, and their names.
    """
    points = supports.points
    _check_directions(frictions)
    jumps, normals = Jumps.of(frictions), np.concatenate([points[:0], *(f.across for f in frictions)])
    first, term = merged(jumps, normals, kinds=_grounds(frictions))
    under = None if all(f.ground is None for f in frictions) else partial(_moved, frictions, first)
    held = freedom(jumps[first], normals[first], supports, times, under)
    acting = np.flatnonzero(held.slides)
    kept = np.concatenate([acting, np.flatnonzero((held.normal_only | held.dragged) & ~held.slides)])
    ends = ends_of_groups(owns[0], term)
    if under is not None:
        _refuse_overlap(frictions, owns[0], ends)
    ends = ends[kept]
    tangents = tangents_of(normals[first][kept])
    moves = under is not None and len(kept) > 0
    return Terms(
        rows=jumps[first][kept].matrix(tangents, points),
        jumps=jumps[first][kept],
        tangents=tangents,
        lengths=lengths_of(ends),
        directed=_of_rows(frictions, [f.directions is not None for f in frictions]).astype(bool)[first][kept],
        frictions=frictions,
        gather=summing(term, len(first))[kept],
        sign=np.sign(np.einsum("ij,ij->i", normals, normals[first][term])),
        acting=len(acting),
        dragged=held.dragged[kept],
        ends=ends,
        names=owns[1],
        ground=_relative(tangents, partial(_moved, frictions, first[kept]), times) if moves else None,
    )


def _grounds(frictions: Sequence[Friction]) -> Ints:
    """Which ground each row of all frictions is on: the first friction that rubs on it."""
    grounds = [None if f.ground is None else f.ground.value for f in frictions]
    return _of_rows(frictions, [next(k for k, other in enumerate(grounds) if other is ground) for ground in grounds])


def _of_rows(frictions: Sequence[Friction], numbers: Sequence[int]) -> Ints:
    """The number of the friction of each row."""
    return np.repeat(np.array(numbers, dtype=np.int64), [len(f.nodes) for f in frictions])


def _moved(frictions: Sequence[Friction], rows: Ints, t: float) -> Floats:
    """How far the ground of these rows, of all frictions one after the other, has moved, (k, dim)."""
    each = [np.zeros(f.normals.shape) if f.ground is None else f.ground.vector(t) for f in frictions]
    moved: Floats = np.concatenate(each)[rows]
    return moved


def _relative(tangents: Floats, moved: Moving, times: Sequence[float]) -> Callable[[float], Floats]:
    """The same along the tangents, and since the first instant: where a ground has begun counts for nothing."""
    start = along(tangents, moved(float(times[0]))) if len(times) else 0.0
    return lambda t: along(tangents, moved(t)) - start


def _refuse_overlap(frictions: Sequence[Friction], owns: sp.csr_matrix, ends: sp.csr_matrix) -> None:
    """Raise SceneError where two terms own an edge: they rub on it, and on grounds that move differently."""
    twice = np.flatnonzero(np.bincount(ends.indices, minlength=ends.shape[1]) > 1)
    if len(twice):
        owner = _of_rows(frictions, range(len(frictions)))
        one, other = np.unique(owner[owns[:, twice[:1]].nonzero()[0]])[:2]
        raise SceneError(
            f"{frictions[one].subject} and {frictions[other].subject}: they act on the same edges, but their grounds "
            "move differently; give each ground its own part of the boundary, or both the same function."
        )


def _check_directions(frictions: Sequence[Friction]) -> None:
    for f in frictions:
        if f.directions is None:
            continue
        block, shape = tangents_of(f.normals[:1]).shape[1], np.shape(f.directions)
        if block > 1 or shape != f.normals.shape or np.abs(np.linalg.norm(f.directions, axis=1) - 1).max() > PARALLEL:
            raise SceneError(
                f"{f.subject}: found directions of shape {shape} for normals of shape {f.normals.shape}; rows along "
                "directions are for bodies in the plane, one unit vector a row."
            )


def norm_terms(terms: Terms, law: FrictionLaw | None, supports: Supports) -> Norms | None:
    """The terms that some unknown moves."""
    m, none = terms.acting, np.zeros(terms.acting)
    if m == 0:
        return None
    rest = np.zeros(len(terms.nodes) - m)
    ground, slope = terms.ground, None if law is None or not law.has_slope else law.slope
    under, softening = (None, None) if law is None else (law.part(slice(0, m)), law.softening)
    remembers = law is not None and law.remembers
    block = terms.rows.shape[0] // len(terms.nodes)
    return Norms(
        B=on_free(acting_rows(terms), supports),
        w=terms.weights(0.0)[:m] if all(f.steady for f in terms.frictions) else lambda t: terms.weights(t)[:m],
        block=block,
        places=supports.places(terms.nodes),
        law=None if under is None or remembers else lambda t, p: under(t, p, none, none),
        bias=(lambda t: terms.bias(t)[: m * block]) if terms.one_way else None,
        slope=None if slope is None else lambda t, p, *past: slope(t, p, np.append(past or none, rest))[:m],
        ground=None if ground is None else lambda t: ground(t)[: m * block],
        slip_law=under if remembers else None,
        softening=None if softening is None else softening[:m],
    )


def dragged_terms(terms: Terms, law: FrictionLaw | None, supports: Supports) -> DraggedTerms | None:
    """The terms that none does."""
    m, q = terms.acting, len(terms.nodes) - terms.acting
    if q == 0:
        return None
    block, ground = terms.rows.shape[0] // len(terms.nodes), terms.ground
    rows, under = terms.rows[m * block :], None if law is None else law.part(slice(m, m + q))
    return DraggedTerms(
        position=lambda t: rows @ supports.motion(t) - (0.0 if ground is None else ground(t)[m * block :]),
        weights=(lambda t, p, past, slip: terms.weights(t)[m:]) if under is None else under,
        count=q,
        block=block,
        bias=(lambda t: terms.bias(t)[m * block :]) if terms.one_way else None,
        remembers=law is not None and law.remembers,
    )


def acting_rows(terms: Terms) -> sp.csr_matrix:
    """B^ of the terms that some unknown moves."""
    block = terms.rows.shape[0] // max(len(terms.nodes), 1)
    return terms.rows[: terms.acting * block]


def warn_of_free_normals(frictions: Sequence[Friction], supports: Supports, stopped: Ints) -> None:
    """Friction where nothing holds the normal is a body rubbing on air: almost always a forgotten contact."""
    glued = [f.nodes for f in frictions if f.directions is not None]
    stopped = np.concatenate([stopped, *glued])
    for friction in frictions:
        if friction.law is not None or friction.directions is not None:
            continue
        free = normal_is_free(Jumps.of([friction]), friction.normals, supports) & ~np.isin(friction.nodes, stopped)
        if free.any():
            warnings.warn(
                f"{friction.subject}: at {free.sum()} of {len(free)} places nothing holds the body in the normal "
                "direction; add BilateralContact on the same boundary, unless it is meant to slide on air.",
                SceneWarning,
                stacklevel=2,
            )
