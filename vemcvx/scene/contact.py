"""The terms of contact and friction: limits and norm terms over all nodal values, and the law of their weights."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import EPS, SAME, Bools, Floats, Ints
from vemcvx.effects import Friction, Law, Obstacle
from vemcvx.effects.data import finite_a_row
from vemcvx.errors import SceneError, SceneWarning
from vemcvx.program.operators import Norms, Rows
from vemcvx.program.system import DraggedTerms, Limits
from vemcvx.scene.supports import (
    ContactRows,
    Moving,
    Supports,
    along,
    freedom,
    merged,
    normal_is_free,
    normal_reactions,
    normal_rows,
    on_free,
    summing,
)
from vemcvx.vem import tangents_of


# The norm terms of friction, over all nodal values, and what a System knows of them.
#
# A friction effect brings one row a node and distinct normal; rows of one node with one normal are one term, whose
# weights add up and whose length is that of all their edges; where they rub on grounds that move differently, each is
# a term of its own. Over u the matrix of the terms is B^ (orthonormal tangents); over the free unknowns it is B = B^
# P. Terms that no free unknown moves come last. They are kept where supports drag their nodes along the contact, which
# dissipates, or where contact presses on them, which is reported; all others are dropped.
@dataclass(frozen=True, kw_only=True)
class Terms(ContactRows):
    """The norm terms of a posed scene, over all nodal values; `normals` are what their tangents are across."""

    rows: sp.csr_matrix  # (m * (dim - 1), n_u) B^, the products with `tangents`
    tangents: Floats  # (m, dim - 1, dim) orthonormal, but for those that `Friction.read` gives
    directed: Bools  # (m,) which are along directions that their friction gives
    elliptic: Bools  # (m,) which are of friction by direction
    frictions: Sequence[Friction]
    gather: sp.csr_matrix  # (m, rows) which rows of all frictions, one after the other, add up to a term
    sign: Floats  # (rows,) 1 where the tangent of a row is that of its term, else -1
    acting: int = 0  # how many of the m, the first, some free unknown moves
    dragged: Bools | None = None  # (m,) which of them supports move along the boundary, in some direction at least
    ground: Callable[[float], Floats] | None = None  # t -> (m * (dim - 1),) its way along tangents since times[0]
    reported: Callable[[float], Floats] | None = None  # t -> (m, dim), that motion as a vector
    press: sp.csr_matrix | None = None  # (rows, r) which limits press on rows whose law reads it; None without laws

    def weights(self, t: float) -> Floats:
        """Weights (m,) at the instant `t`: those of their rows added up, without what follows the answer."""
        at = f"weights at t = {t:.6g}"
        each = (finite_a_row(f.weights(t), len(f.nodes), f"{f.subject}: {at}") for f in self.frictions)
        return self.gather @ np.concatenate([np.zeros(0), *each])

    @property
    def block(self) -> int:
        """The number of components of a term."""
        return self.tangents.shape[1]

    @property
    def acting_rows(self) -> sp.csr_matrix:
        """B^ of the terms that some unknown moves."""
        return self.rows[: self.acting * self.block]

    @property
    def one_way(self) -> bool:
        """True if some cost more one way than the other."""
        return any(f.bias is not None for f in self.frictions)

    def bias(self, t: float) -> Floats:
        """The bias (m,) at the instant `t`, along the tangent of each term."""
        each = [np.zeros(len(f.nodes)) if f.bias is None else f.bias(t) for f in self.frictions]
        return self.gather @ (self.sign * np.concatenate([np.zeros(0), *each]))

    def law(self, some: slice) -> Law | None:
        """The law of some of the terms, given the forces p (r,) of all limits and the slips of these terms.

        None if all weights are given. Rows read the forces that press on them and the slip of their term; weights of
        rows add up.
        """
        frictions, gather, press = self.frictions, self.gather[some], self.press
        laws = [f.law for f in frictions if f.law is not None]
        if press is None or not laws:
            return None
        slips, spread, still = any(law.slips for law in laws), gather.T, np.zeros(gather.shape[1])
        pressed, gathered = Rows(press).read, Rows(sp.csr_matrix(gather)).read
        own, (made, indices, indptr) = _slices(frictions), _entries(gather, press)

        @lru_cache(maxsize=1)  # Steps are on few pieces of a law.
        def matrix(steep: bytes) -> sp.csr_matrix:
            entries = made @ np.frombuffer(steep)
            entries.flags.writeable = False
            return sp.csr_matrix((entries, indices, indptr), shape=(gather.shape[0], press.shape[1]))

        def each(p: Floats, *of_terms: Floats) -> Iterable[tuple[Friction, list[Floats]]]:
            of_rows = [pressed(p), *(spread @ slip if slips else still for slip in of_terms)]
            return [(f, [values[rows] for values in of_rows]) for f, rows in zip(frictions, own, strict=True)]

        def weights(t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
            return gathered(np.concatenate([f.weights_under(t, *under) for f, under in each(p, past, slip)]))

        def slope(t: float, p: Floats, past: Floats) -> sp.csr_matrix:
            return matrix(np.concatenate([f.slope_under(t, *under) for f, under in each(p, past)]).tobytes())

        soft = all(law.softening is not None for law in laws)
        softening = gather @ np.concatenate([f.softening for f in frictions]) if soft else None
        known = all(law.slope is not None for law in laws)
        return Law(weights, softening, any(law.pressed for law in laws), slope if known else None, slips)


def friction_terms(
    frictions: Sequence[Friction],
    table: ContactRows,
    supports: Supports,
    times: Sequence[float] = (),
    *,
    known: Sequence[float],
    obstacles: Obstacles,
) -> Terms:
    """The terms of all frictions where something can slip or is dragged; equal node, normal and ground make one term.

    The `table` has their rows, on which `obstacles` press; at the instants `known` laws say along what they read slip.
    """
    points = supports.points
    _check_directions(frictions)
    normals = np.concatenate([points[:0], *(f.across for f in frictions)])
    each = np.concatenate([tangents_of(points[:0]), *(f.read(known) for f in frictions)])
    first, term = merged((table.nodes, table.partners), normals, kinds=_kinds(frictions))
    every = replace(table, normals=normals).joined(first, term)
    under = None if all(f.ground is None for f in frictions) else partial(_moved, frictions, first)
    held = freedom(every, supports, times, under, tangents=each[first])
    acting = np.flatnonzero(held.slides)
    kept = np.concatenate([acting, np.flatnonzero((held.normal_only | held.dragged) & ~held.slides)])
    if under is not None:
        _refuse_overlap(frictions, table.ends, every.ends)
    rows, tangents = every[kept], each[first][kept]
    moved = None if under is None or not len(kept) else partial(_moved, frictions, first[kept])
    elliptic = _of_rows(frictions, [f.ellipse is not None for f in frictions]).astype(bool)[first][kept]
    # What an ellipse shortens, or does not read at all, is slip nonetheless.
    unit = np.where(elliptic[:, None, None], tangents_of(rows.normals), tangents)
    ground = slid = None
    if moved is not None:
        ground, slid = (_relative(some, moved, times) for some in (tangents, unit))
    return Terms(
        **rows.columns,
        rows=rows.matrix(tangents, points),
        tangents=tangents,
        directed=_of_rows(frictions, [f.directions is not None for f in frictions]).astype(bool)[first][kept],
        elliptic=elliptic,
        frictions=frictions,
        gather=summing(term, len(first))[kept],
        sign=np.sign(np.einsum("ij,ij->i", normals, normals[first][term])),
        acting=len(acting),
        dragged=held.dragged[kept],
        ground=ground,
        reported=slid and (lambda t: np.einsum("mb,mbd->md", slid(t).reshape(unit.shape[:2]), unit)),
        press=_pressures(frictions, table, obstacles, supports) if len(kept) else None,
    )


def _kinds(frictions: Sequence[Friction]) -> Ints:
    """The kind of each row of all frictions, the number of the first friction of it: rows of one kind may be one term.

    They rub on one ground, have one ellipse and, in space, are all along given directions or none of them.
    """
    grounds = [f.ground and id(f.ground.value) for f in frictions]
    ways = [(f.ellipse and id(f.ellipse), f.directions is not None and not f.in_plane) for f in frictions]
    kinds = list(zip(grounds, ways, strict=True))
    return _of_rows(frictions, [kinds.index(kind) for kind in kinds])


def _of_rows(frictions: Sequence[Friction], numbers: Sequence[int]) -> Ints:
    """The number of the friction of each row."""
    return np.repeat(np.array(numbers, dtype=np.int64), [len(f.nodes) for f in frictions])


def _moved(frictions: Sequence[Friction], rows: Ints, t: float) -> Floats:
    """The motion of the ground of these rows, of all frictions one after the other, (k, dim)."""
    each = [np.zeros(f.normals.shape) if f.ground is None else f.ground.vector(t) for f in frictions]
    return np.concatenate(each)[rows]


def _relative(tangents: Floats, moved: Moving, times: Sequence[float]) -> Callable[[float], Floats]:
    """The motion along the tangents since the first instant."""
    start = along(tangents, moved(float(times[0]))) if len(times) else 0.0
    return lambda t: along(tangents, moved(t)) - start


def _refuse_overlap(frictions: Sequence[Friction], owns: sp.csr_matrix, ends: sp.csr_matrix) -> None:
    """Raise SceneError where two terms own an edge, with grounds that move differently."""
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
        shape = np.shape(f.directions)
        if shape != f.normals.shape or np.abs(np.linalg.norm(f.directions, axis=1) - 1).max() > SAME:
            raise SceneError(
                f"{f.subject}: found directions of shape {shape} for normals of shape {f.normals.shape}; rows along "
                "directions have one unit vector a row."
            )


def _entries(gather: sp.csr_matrix, press: sp.csr_matrix) -> tuple[sp.csr_matrix, Ints, Ints]:
    """made, indices and ends of rows: the product gather diag(x) press has the entries made @ x there, x (rows,)."""
    of_press = press.tocoo()
    pairs = sp.csr_matrix(gather[:, of_press.row]).tocoo()
    term, row, limit = pairs.row.astype(np.int64), of_press.row[pairs.col], of_press.col[pairs.col]
    place, slot = np.unique(term * press.shape[1] + limit, return_inverse=True)
    made = sp.csr_matrix((pairs.data * of_press.data[pairs.col], (slot, row)), shape=(len(place), press.shape[0]))
    ends = np.arange(gather.shape[0] + 1) * press.shape[1]
    return made, place % max(press.shape[1], 1), np.searchsorted(place, ends)


def _slices(frictions: Sequence[Friction]) -> list[slice]:
    """The rows of each friction among those of all."""
    ends = np.cumsum([len(f.nodes) for f in frictions])
    return [slice(end - len(f.nodes), end) for f, end in zip(frictions, ends, strict=True)]


def norm_terms(terms: Terms, supports: Supports) -> Norms | None:
    """The terms that some unknown moves."""
    m, block, ground = terms.acting, terms.block, terms.ground
    if m == 0:
        return None
    return Norms(
        B=on_free(terms.acting_rows, supports),
        w=terms.weights(0.0)[:m] if all(f.steady for f in terms.frictions) else lambda t: terms.weights(t)[:m],
        block=block,
        places=supports.places(terms.nodes),
        law=terms.law(slice(0, m)),
        bias=(lambda t: terms.bias(t)[: m * block]) if terms.one_way else None,
        ground=None if ground is None else lambda t: ground(t)[: m * block],
    )


def dragged_terms(terms: Terms, supports: Supports) -> DraggedTerms | None:
    """The terms that no unknown moves."""
    m, q, block, ground = terms.acting, len(terms) - terms.acting, terms.block, terms.ground
    if q == 0:
        return None
    rows, law = terms.rows[m * block :], terms.law(slice(m, m + q))
    weights: Callable[..., Any] = (lambda t, p, past, slip: terms.weights(t)[m:]) if law is None else law.weights
    return DraggedTerms(
        position=lambda t: rows @ supports.motion(t) - (0.0 if ground is None else ground(t)[m * block :]),
        weights=weights,
        count=q,
        block=block,
        bias=(lambda t: terms.bias(t)[m * block :]) if terms.one_way else None,
        remembers=law is not None and law.slips,
    )


def warn_of_free_normals(
    frictions: Sequence[Friction], supports: Supports, obstacles: Obstacles, springs: sp.csr_matrix | None
) -> None:
    """Friction where nothing holds the normal is a body rubbing on air: almost always a forgotten contact."""
    sprung = [] if springs is None else [np.flatnonzero(springs.diagonal() > 0) // supports.points.shape[1]]
    stopped = np.concatenate([obstacles.nodes, *sprung, *(f.nodes for f in frictions if f.directions is not None)])
    for friction in frictions:
        law = friction.law
        if (law is not None and law.pressed) or friction.directions is not None:
            continue
        rows = ContactRows.of([friction], supports.points.shape[1])
        free = normal_is_free(rows, supports) & ~np.isin(friction.nodes, stopped)
        if free.any():
            warnings.warn(
                f"{friction.subject}: at {free.sum()} of {len(free)} places nothing holds the body in the normal "
                "direction; add BilateralContact on the same boundary, unless it is meant to slide on air.",
                SceneWarning,
                stacklevel=2,
            )


@dataclass(frozen=True, kw_only=True)
class Surface(ContactRows):
    """The nodes of contact that are not held otherwise, ordered; at a corner, all rows are of both sides.

    Normals are means by length there, and lengths are sums. Contact presses on partners the other way.
    """

    normal_reaction: sp.csr_matrix  # (m, n_u) g: contact presses with -g . R, R the forces of supports and contact


def contact_surface(
    table: ContactRows, moves: Bools, terms: Terms, supports: Supports, times: Sequence[float] = ()
) -> Surface:
    """The surface of contact: all rows of the table; edges that several of them bring count once.

    A node that supports drag, or ground that moves, as `moves` (m,) says, belongs to it where it rubs, so where it has
    a term of `terms`.
    """
    first, row = merged((table.nodes, table.partners), table.normals)
    every = table.joined(first, row)
    held = freedom(every, supports, times)
    drawn = np.zeros(len(first), dtype=bool)
    np.logical_or.at(drawn, row, moves)
    rubs = (held.dragged | drawn) & (terms[terms.acting :].find(every) >= 0)
    kept = np.flatnonzero(held.slides | held.normal_only | rubs)
    rows = every[kept]
    lead, place = rows.distinct
    together = summing(place, len(lead))
    surface = replace(rows[lead], normals=together @ (rows.lengths[:, None] * rows.normals), ends=together @ rows.ends)
    unit = surface.normals / np.linalg.norm(surface.normals, axis=1)[:, None]
    reaction = sp.csr_matrix(together @ normal_reactions(rows, supports))
    return Surface(**replace(surface, normals=unit).columns, normal_reaction=reaction)


# The limits of one-sided contact, over all nodal values and for a System; what presses on friction.
#
# Rigid obstacles that meet at a node with one normal are one limit, at the smallest of their gaps, which acts on all
# their edges; compliant obstacles each act with a force of their own.
@dataclass(frozen=True, kw_only=True)
class Obstacles(ContactRows):
    """The limits of a posed scene."""

    rows: sp.csr_matrix  # (r, n_u) D^, unit normals
    compliance: Floats
    gap: Callable[[float], Floats]  # t -> (r,)
    subjects: tuple[str, ...] = ()  # whose they are, in words
    prescribed: Obstacles | None = None  # those whose gaps supports alone decide: no limits, but checked


def gathered(obstacles: Sequence[Obstacle], table: ContactRows, supports: Supports) -> Obstacles:
    """The limits of all obstacles, whose rows are in the `table`, where something can move."""
    points = supports.points
    each = (finite_a_row(o.compliance, len(o.nodes), f"{o.subject}: compliance") for o in obstacles)
    compliance = np.concatenate([np.zeros(0), *each])
    kinds = np.where(compliance == 0, -1, np.arange(len(table)))
    lead, place = merged((table.nodes, table.partners), table.normals, signed=True, kinds=kinds)
    first, limit = np.sort(lead), np.argsort(np.argsort(lead))[place]
    every = table.joined(first, limit)
    rows = normal_rows(every, points)
    moves = np.diff(on_free(rows, supports).indptr) > 0
    # Gaps are differences of lengths as large as coordinates, each rounded, and so are they: 3/2 EPS of these, and as
    # much again for what lengths are computed from. Gaps that are negative by no more than this are zero.
    rounding = 4 * EPS * float(np.abs(points).max())

    def those(chosen: Ints) -> Obstacles:
        def gap(t: float) -> Floats:
            nearest = np.full(len(first), np.inf)
            gaps = [finite_a_row(o.gap(t), len(o.nodes), f"{o.subject}: gap at t = {t:.6g}") for o in obstacles]
            np.minimum.at(nearest, limit, np.concatenate([nearest[:0], *gaps]))
            return np.where((-rounding <= nearest) & (nearest < 0), 0.0, nearest)[chosen]

        return Obstacles(
            **every[chosen].columns,
            rows=sp.csr_matrix(rows[chosen]),
            compliance=compliance[first][chosen],
            gap=gap,
            subjects=tuple(o.subject for o in obstacles),
        )

    return replace(those(np.flatnonzero(moves)), prescribed=None if moves.all() else those(np.flatnonzero(~moves)))


def limits(obstacles: Obstacles, supports: Supports) -> Limits | None:
    """The limits of obstacles, over the free unknowns."""
    if len(obstacles.nodes) == 0:
        return None
    rows, places = on_free(obstacles.rows, supports), supports.places(obstacles.nodes)
    return Limits(rows, obstacles.gap, obstacles.compliance, places)


def _pressures(
    frictions: Sequence[Friction], table: ContactRows, obstacles: Obstacles, supports: Supports
) -> sp.csr_matrix | None:
    """(rows of all frictions, r) which limits press on rows whose law reads it, each with the share of its edges there.

    None if no weight has a law. SceneError where nothing presses on a node that is free to move, but a law reads it.
    """
    if all(f.law is None for f in frictions):
        return None
    reads = _of_rows(frictions, [f.law is not None and f.law.pressed for f in frictions]).astype(bool)
    shares = sp.csr_matrix(sp.diags_array(reads.astype(float)) @ table.shares(obstacles))
    shares.eliminate_zeros()
    bare = reads & (np.diff(shares.indptr) == 0) & (normal_is_free(table, supports) | (len(obstacles) == 0))
    for f, rows in zip(frictions, _slices(frictions), strict=True):
        if bare[rows].any():
            raise SceneError(
                f"{f.subject}: no pressure is known at {bare[rows].sum()} of {len(f.nodes)} places; it needs "
                "UnilateralContact or NormalCompliance on the same boundary (with BilateralContact, TrescaFriction "
                "without while_closed)."
            )
    return shares


def out_of_reach(terms: Terms, obstacles: Sequence[Obstacle], supports: Supports) -> list[str]:
    """A sentence for each friction and obstacle without effect: no node of it can move, or is moved."""
    moving = np.arange(len(terms.nodes)) < terms.acting
    if terms.dragged is not None:
        moving = moving | terms.dragged
    held = [f.subject for f in terms.frictions if not np.isin(f.nodes, terms.nodes[moving]).any()]
    dim = supports.points.shape[1]
    held += [o.subject for o in obstacles if not normal_is_free(ContactRows.of([o], dim), supports).any()]
    return [f"{subject}: all its nodes are held otherwise" for subject in held]
