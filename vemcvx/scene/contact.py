"""The terms of contact and friction: limits and norm terms over all nodal values, and the law of their weights."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import EPS, SAME, Bools, Floats, Ints
from vemcvx.base.errors import SceneError, SceneWarning, VemcvxError
from vemcvx.effects import ContactSurface, Friction, Law, Obstacle, Support
from vemcvx.effects.data import finite_a_row, weight_a_row
from vemcvx.meshes import Interface
from vemcvx.meshes.polygons import all_found_in
from vemcvx.program.system import DRAG_ROUNDING, DraggedTerms, Limits, Norms
from vemcvx.scene.rows import ContactRows, along, distinct_pairs, merged, pair_numbers, pairs_of, summing
from vemcvx.scene.supports import Supports
from vemcvx.vem import tangents_of

# A node belongs to contact unless it is held otherwise: where its tangent is free, where its normal is (the axis of a
# half model, whose tangent a support holds), where contact itself holds its normal and a support its tangent, and
# where supports drag it along against friction. Of the forces H'R that hold a node, the part along the normal of
# contact is contact's; so is that of a single support that moves a node along that normal (an obstacle that moves).
Moving = Callable[[float], Floats]
"""t -> displacements (k, dim) of the ground under k rows, or their components along the rows."""


class Freedom(NamedTuple):
    """The freedom that supports leave to rows of contact, as arrays (k,)."""

    slides: Bools  # True if some free unknown moves the node along the boundary
    dragged: Bools  # if it does not slide, in some direction, and supports or the ground move along the boundary
    normal_only: Bools  # if its tangent is held, but its normal is contact's: it has a pressure


def _freedom(
    rows: ContactRows, tangents: Floats, supports: Supports, times: Sequence[float], ground: Moving | None = None
) -> Freedom:
    """Return the freedom of rows that slide along `tangents` (k, dim - 1, dim), over `ground` if there is one."""
    reads, per = rows.matrix(tangents, supports.points), tangents.shape[1]
    B = supports.on_free(reads)
    # How much free unknowns move each row along its tangents: eigenvalues (k, dim - 1), ascending; zero where not.
    parts = [B[axis::per] for axis in range(per)]
    products = np.array([[np.asarray(one.multiply(other).sum(axis=1)).ravel() for other in parts] for one in parts])
    each = np.linalg.eigvalsh(products.transpose(2, 0, 1))
    slides, held = each[:, -1] > 0, np.flatnonzero(each[:, 0] <= SAME * each[:, -1])
    dragged, normal_only = np.zeros(len(rows), dtype=bool), np.zeros(len(rows), dtype=bool)
    if len(held) and not (supports.still and ground is None):
        B_held = reads[(held[:, None] * per + np.arange(per)).ravel()]

        def moved(t: float) -> Floats:
            return B_held @ supports.motion(t) - (0.0 if ground is None else along(tangents[held], ground(t)[held]))

        dragged[held] = _dragged(moved, rows[held], supports, times, under_way=ground is not None)
    if not slides.all():
        normal_only = ~slides & (_normal_is_free(rows, supports) | _held_normals(rows, supports)[0])
    return Freedom(slides, dragged, normal_only)


def _normal_is_free(rows: ContactRows, supports: Supports) -> Bools:
    """Return True if some free unknown moves the node along the normal, (k,)."""
    return np.diff(supports.on_free(rows.normal_rows(supports.points)).indptr) > 0


def _dragged(moved: Moving, rows: ContactRows, supports: Supports, times: Sequence[float], under_way: bool) -> Bools:
    """Return True if rows are `moved` along their tangents between any two instants, (k,); if ground is `under_way`."""
    dragged = np.zeros(len(rows), dtype=bool)
    if len(times) == 0:
        nodes = supports.moved // supports.points.shape[1]
        return ~dragged if under_way else np.isin(rows.nodes, nodes) | np.isin(rows.partners, nodes)
    try:
        start = moved(float(times[0]))
        for t in times[1:]:
            at = moved(float(t))
            size = max(np.abs(at).max(), np.abs(start).max())
            dragged |= (np.abs(at - start) > DRAG_ROUNDING * size).reshape(len(rows), -1).any(axis=1)
            if dragged.all():
                break
    except VemcvxError:
        return np.ones(len(rows), dtype=bool)  # The step that needs the datum says what is wrong with it.
    return dragged


def _normal_reactions(rows: ContactRows, supports: Supports) -> sp.csr_matrix:
    """g (k, n_u): contact holds the normal of each of k rows with the force -g . R of reactions R; zero elsewhere."""
    entries, places = _held_normals(rows, supports)[1:]
    return sp.csr_matrix(sp.csr_matrix((entries, places), shape=(len(rows), len(supports.depends))) @ supports.H.T)


def _held_normals(rows: ContactRows, supports: Supports) -> tuple[Bools, Floats, tuple[Ints, Ints]]:
    """Return where contact alone holds the normal of a row, (k,).

    Besides, the cosines between the normals of rows and those rows of A by which contact holds them, and their places.
    """
    (nodes, partners), holds = pairs_of(supports.given), np.flatnonzero(~supports.depends)
    directions = np.concatenate([supports.points[:0], *(support.directions for support in supports.given)])[holds]
    contact = supports.of_rows([support.contact for support in supports.given])[holds]
    nodes, partners = nodes[holds], partners[holds]
    # The pairs of a row and what holds its node, or its node and partner, whichever of these is named first.
    wanted, known = (
        pair_numbers(np.maximum(*pair), np.minimum(*pair), len(supports.points))
        for pair in ((rows.nodes, rows.partners), (nodes, partners))
    )
    row, col = all_found_in(known, wanted)
    cosine = np.einsum("ij,ij->i", directions[col], rows.normals[row])
    same = np.linalg.norm(directions[col] - cosine[:, None] * rows.normals[row], axis=1) < SAME
    row, col, cosine = row[same], col[same], cosine[same] * np.where(nodes[col] == rows.nodes[row], 1.0, -1.0)[same]
    # How many rows hold the site of each row, and how many of these are contact's.
    site, mine, size = supports.sites[nodes], supports.sites[rows.nodes], len(supports.sites)
    count, of_contact = np.bincount(site, minlength=size)[mine], np.bincount(site[contact], minlength=size)[mine]
    held_by_contact = np.zeros(len(rows), dtype=bool)
    # Where contact alone holds a node altogether, at its corners, the node is no place of contact.
    held_by_contact[row[contact[col]]] = True
    takes = contact[col] | (count[row] == 1)
    return held_by_contact & (of_contact == 1), cosine[takes], (row[takes], holds[col[takes]])


# Rows of friction of one node with one normal are one term, whose weights add up and whose length is that of all their
# edges, unless they rub on grounds that move differently. Over u the matrix of the terms is B^ (orthonormal tangents),
# over the free unknowns B = B^ P. Terms that no free unknown moves come last, and are kept where supports drag their
# nodes along the contact, which dissipates, or where contact presses on them, which is reported.
@dataclass(frozen=True, kw_only=True)
class Terms(ContactRows):
    """The norm terms of a posed scene, over all nodal values; `normals` are what their tangents are across."""

    rows: sp.csr_matrix  # (m * (dim - 1), n_u) B^, the products with `tangents`
    tangents: Floats  # (m, dim - 1, dim) orthonormal, but for those that `Friction.read` gives
    directed: Bools  # (m,) which are along directions that their friction gives
    elliptic: Bools  # (m,) which are of friction by direction
    frictions: Sequence[Friction]
    gather: sp.csr_matrix  # (m, rows) which rows of all frictions, one after the other, add up to a term
    acting: int = 0  # how many of the m, the first, some free unknown moves
    dragged: Bools | None = None  # (m,) which of them supports move along the boundary, in some direction at least
    ground: Callable[[float], Floats] | None = None  # t -> (m * (dim - 1),) its way along tangents since times[0]
    reported: Callable[[float], Floats] | None = None  # t -> (m, dim), that motion as a vector
    press: sp.csr_matrix | None = None  # (rows, r) which limits press on rows whose law reads it; None without laws

    def weights(self, t: float) -> Floats:
        """Return weights (m,) at the instant `t`: those of their rows added up, without what follows the answer."""
        at, own = f"weights at t = {t:.6g}", self.frictions
        each = (weight_a_row(f.weights(t), len(f.nodes), f"{f.subject}: {at}") for f in own)
        return self.gather @ np.concatenate([np.zeros(0), *each])

    @property
    def block(self) -> int:
        """The number of components of a term."""
        return self.tangents.shape[1]

    @property
    def acting_rows(self) -> sp.csr_matrix:
        """B^ of the terms that some unknown moves."""
        return self.rows[: self.acting * self.block]

    def norms(self, supports: Supports) -> Norms | None:
        """The terms that some unknown moves."""
        m, block, ground = self.acting, self.block, self.ground
        if m == 0:
            return None
        return Norms(
            B=supports.on_free(self.acting_rows),
            w=self.weights(0.0)[:m] if all(f.steady for f in self.frictions) else lambda t: self.weights(t)[:m],
            block=block,
            places=supports.places(self.nodes),
            law=self._law(slice(0, m)),
            ground=None if ground is None else lambda t: ground(t)[: m * block],
        )

    def carried(self, supports: Supports) -> DraggedTerms | None:
        """The terms that no unknown moves."""
        m, block, ground = self.acting, self.block, self.ground
        if m == len(self):
            return None
        rows, law = self.rows[m * block :], self._law(slice(m, len(self)))
        weights: Callable[..., Any] = (lambda t, p, past, slip: self.weights(t)[m:]) if law is None else law.weights
        return DraggedTerms(
            position=lambda t: rows @ supports.motion(t) - (0.0 if ground is None else ground(t)[m * block :]),
            weights=weights,
            count=len(self) - m,
            block=block,
            remembers=law is not None and law.slips,
        )

    def _law(self, some: slice) -> Law | None:
        """Return the law of some of the terms, given the forces p (r,) of all limits and the slips of these terms.

        None if all weights are given. Rows read the forces that press on them and the slip of their term.
        """
        frictions, gather, press = self.frictions, sp.csr_matrix(self.gather[some]), self.press
        laws = [f.law for f in frictions if f.law is not None]
        if press is None or not laws:
            return None
        slips, still = any(law.slips for law in laws), np.zeros(gather.shape[1])
        spread, own = gather.T, _slices(frictions)

        def each(p: Floats, *of_terms: Floats) -> Iterable[tuple[Friction, list[Floats]]]:
            of_rows = [press @ p, *(spread @ slip if slips else still for slip in of_terms)]
            return [(f, [values[rows] for values in of_rows]) for f, rows in zip(frictions, own, strict=True)]

        def weights(t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
            return gather @ np.concatenate([f.weights_under(t, *under) for f, under in each(p, past, slip)])

        def slope(t: float, p: Floats, past: Floats) -> sp.csr_matrix:
            steep = np.concatenate([f.slope_under(t, *under) for f, under in each(p, past)])
            entries = press.data * np.repeat(steep, np.diff(press.indptr))
            return sp.csr_matrix(gather @ sp.csr_matrix((entries, press.indices, press.indptr), shape=press.shape))

        soft = all(law.softening is not None for law in laws)
        softening = gather @ np.concatenate([f.softening for f in frictions]) if soft else None
        known = all(law.slope is not None for law in laws)
        return Law(weights, softening, any(law.pressed for law in laws), slope if known else None, slips)


def _friction_terms(
    frictions: Sequence[Friction],
    table: ContactRows,
    supports: Supports,
    times: Sequence[float],
    known: Sequence[float],
    obstacles: Obstacles,
) -> Terms:
    """Return the terms of all frictions where something can slip or is dragged; their rows are in the `table`."""
    points = supports.points
    normals = np.concatenate([points[:0], *(f.across for f in frictions)])
    each = np.concatenate([tangents_of(points[:0]), *(f.read(known) for f in frictions)])
    first, term = merged((table.nodes, table.partners), normals, kinds=_kinds(frictions))
    every, tangents, under = replace(table, normals=normals).joined(first, term), each[first], None
    if any(f.ground is not None for f in frictions):
        under = partial(_moved, frictions, first)
        _refuse_overlap(frictions, table.ends, every.ends)
    held = _freedom(every, tangents, supports, times, under)
    acting = np.flatnonzero(held.slides)
    kept = np.concatenate([acting, np.flatnonzero((held.normal_only | held.dragged) & ~held.slides)])
    rows, tangents = every[kept], tangents[kept]
    directed, elliptic = (
        _of_rows(frictions, flags).astype(bool)[first][kept]
        for flags in ([f.directions is not None for f in frictions], [f.ellipse is not None for f in frictions])
    )
    # What an ellipse shortens, or does not read at all, is slip nonetheless.
    unit = np.where(elliptic[:, None, None], tangents_of(rows.normals), tangents)
    ground = slid = None
    if under is not None and len(kept):
        ground, slid = (_since(some, partial(_moved, frictions, first[kept]), times) for some in (tangents, unit))
    return Terms(
        **rows.columns,
        rows=rows.matrix(tangents, points),
        tangents=tangents,
        directed=directed,
        elliptic=elliptic,
        frictions=frictions,
        gather=summing(term, len(first))[kept],
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


def _since(tangents: Floats, moved: Moving, times: Sequence[float]) -> Moving:
    """Return the motion along the tangents since the first instant."""
    start = along(tangents, moved(float(times[0]))) if len(times) else 0.0
    return lambda t: along(tangents, moved(t)) - start


def _refuse_overlap(frictions: Sequence[Friction], owns: sp.csr_matrix, ends: sp.csr_matrix) -> None:
    """Raise SceneError where two terms own an edge, with grounds that move differently."""
    twice = np.flatnonzero(np.bincount(ends.indices, minlength=ends.shape[1]) > 1)
    if len(twice):
        owner = _of_rows(frictions, range(len(frictions)))
        one, other = np.unique(owner[owns[:, twice[:1]].nonzero()[0]])[:2]
        both = f"{frictions[one].subject} and {frictions[other].subject}"
        raise SceneError(f"{both}: they act on the same edges, but their grounds move differently.")


def _slices(frictions: Sequence[Friction]) -> list[slice]:
    """The rows of each friction among those of all."""
    ends = np.cumsum([len(f.nodes) for f in frictions])
    return [slice(end - len(f.nodes), end) for f, end in zip(frictions, ends, strict=True)]


def warn_of_free_normals(
    frictions: Sequence[Friction], supports: Supports, obstacles: Obstacles, springs: sp.csr_matrix | None
) -> None:
    """Warn of friction where nothing holds the normal: almost always a forgotten contact."""
    sprung = [] if springs is None else [np.flatnonzero(springs.diagonal() > 0) // supports.points.shape[1]]
    stopped = np.concatenate([obstacles.nodes, *sprung, *(f.nodes for f in frictions if f.directions is not None)])
    for friction in frictions:
        law = friction.law
        if (law is not None and law.pressed) or friction.directions is not None:
            continue
        rows = ContactRows.of([friction], supports.points.shape[1])
        free = _normal_is_free(rows, supports) & ~np.isin(friction.nodes, stopped)
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


def _contact_surface(
    table: ContactRows, moves: Bools, terms: Terms, supports: Supports, times: Sequence[float]
) -> Surface:
    """Return the surface of contact: all rows of the table; edges that several of them bring count once.

    A node that supports drag, or ground that `moves` (m,), belongs to it where it has a term of `terms`.
    """
    first, row = merged((table.nodes, table.partners), table.normals)
    every = table.joined(first, row)
    held = _freedom(every, tangents_of(every.normals), supports, times)
    drawn = np.zeros(len(first), dtype=bool)
    np.logical_or.at(drawn, row, moves)
    rubs = (held.dragged | drawn) & (terms[terms.acting :].find(every) >= 0)
    kept = np.flatnonzero(held.slides | held.normal_only | rubs)
    rows = every[kept]
    lead, place = distinct_pairs(rows.nodes, rows.partners)
    together = summing(place, len(lead))
    surface = replace(rows[lead], normals=together @ (rows.lengths[:, None] * rows.normals), ends=together @ rows.ends)
    unit = surface.normals / np.linalg.norm(surface.normals, axis=1)[:, None]
    reaction = sp.csr_matrix(together @ _normal_reactions(rows, supports))
    return Surface(**replace(surface, normals=unit).columns, normal_reaction=reaction)


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

    def limits(self, supports: Supports) -> Limits | None:
        """The limits, over the free unknowns."""
        if len(self) == 0:
            return None
        return Limits(supports.on_free(self.rows), self.gap, self.compliance, supports.places(self.nodes))


def _obstacles(obstacles: Sequence[Obstacle], table: ContactRows, supports: Supports) -> Obstacles:
    """The limits of all obstacles, whose rows are in the `table`, where something can move."""
    points = supports.points
    each = (finite_a_row(o.compliance, len(o.nodes), f"{o.subject}: compliance") for o in obstacles)
    compliance = np.concatenate([np.zeros(0), *each])
    kinds = np.where(compliance == 0, -1, np.arange(len(table)))
    lead, place = merged((table.nodes, table.partners), table.normals, signed=True, kinds=kinds)
    first, limit = np.sort(lead), np.argsort(np.argsort(lead))[place]
    every = table.joined(first, limit)
    rows = every.normal_rows(points)
    moves = np.diff(supports.on_free(rows).indptr) > 0
    # Gaps are differences of rounded lengths as large as coordinates: those negative by no more than this are zero.
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


def _pressures(
    frictions: Sequence[Friction], table: ContactRows, obstacles: Obstacles, supports: Supports
) -> sp.csr_matrix | None:
    """Return (rows of all frictions, r) which limits press on rows whose law reads it, by the share of their edges.

    None if no weight has a law. SceneError where nothing presses on a node that is free to move, but a law reads it.
    """
    if all(f.law is None for f in frictions):
        return None
    reads = _of_rows(frictions, [f.law is not None and f.law.pressed for f in frictions]).astype(bool)
    shares = sp.csr_matrix(sp.diags_array(reads.astype(float)) @ table.shares(obstacles))
    shares.eliminate_zeros()
    bare = reads & (np.diff(shares.indptr) == 0) & (_normal_is_free(table, supports) | (len(obstacles) == 0))
    for f, rows in zip(frictions, _slices(frictions), strict=True):
        if bare[rows].any():
            raise SceneError(
                f"{f.subject}: no pressure is known at {bare[rows].sum()} of {len(f.nodes)} places; it needs "
                "UnilateralContact or NormalCompliance on the same boundary."
            )
    return shares


def through_obstacles(obstacles: Obstacles, supports: Supports, times: Sequence[float]) -> list[str]:
    """Return a sentence for each support that takes nodes of contact through their obstacle at these instants."""
    held, said, first = obstacles.prescribed, [], 0
    if held is None:
        return []
    moved, gaps = np.array([(held.rows @ supports.motion(t), held.gap(t)) for t in times]).swapaxes(0, 1)
    depth, size = (moved - gaps).max(axis=0), np.maximum(np.abs(moved), np.abs(gaps)).max(initial=0.0)
    reads = sp.csc_matrix(abs(held.rows @ supports.H) > SAME)
    for support in supports.given:
        own = reads[:, first : (first := first + len(support.nodes))]
        through = depth[np.unique(own.nonzero()[0])]
        through = through[through > SAME * size]
        if len(through) and not support.contact:
            places = f"{len(through)} contact node(s) through {', '.join(held.subjects)}"
            said.append(f"{support.subject}: it takes {places}, by up to {through.max():.6g}")
    return said


def out_of_reach(terms: Terms, obstacles: Sequence[Obstacle], supports: Supports) -> list[str]:
    """Return a sentence for each friction and obstacle without effect: no node of it can move, or is moved."""
    moving = np.arange(len(terms.nodes)) < terms.acting
    if terms.dragged is not None:
        moving = moving | terms.dragged
    held = [f.subject for f in terms.frictions if not np.isin(f.nodes, terms.nodes[moving]).any()]
    dim = supports.points.shape[1]
    held += [o.subject for o in obstacles if not _normal_is_free(ContactRows.of([o], dim), supports).any()]
    return [f"{subject}: all its nodes are held otherwise" for subject in held]


def without_contact(interfaces: Mapping[str, Interface], parts: Sequence[ContactSurface | Support]) -> list[str]:
    """Return a sentence for each interface on which none of `parts` joins the two bodies."""
    nodes, partners = pairs_of(parts)
    met = nodes[partners >= 0]
    return [
        f"interface {name!r}: no contact acts on it, so that {' and '.join(interface.bodies)} may overlap. "
        f"If they touch there, give an effect of contact on={name!r}."
        for name, interface in interfaces.items()
        if not np.isin(interface.pairs, met).any()
    ]


def pose_contact(
    surfaces: Sequence[ContactSurface],
    frictions: Sequence[Friction],
    stops: Sequence[Obstacle],
    supports: Supports,
    times: Sequence[float],
    known: Sequence[float],
) -> tuple[Terms, Obstacles, Surface]:
    """Return the terms of friction, the limits of obstacles and the surface that is reported, from one table of rows.

    Terms are dragged between any two of `times`; at the instants `known` frictions say along what they read slip.
    """
    table = ContactRows.of([*surfaces, *frictions, *stops], supports.points.shape[1])
    start, count = sum(len(s.nodes) for s in surfaces), sum(len(f.nodes) for f in frictions)
    rubbing, drawn = slice(start, start + count), np.zeros(len(table), dtype=bool)
    drawn[rubbing] = _of_rows(frictions, [f.ground is not None for f in frictions])
    obstacles = _obstacles(stops, table[rubbing.stop :], supports)
    terms = _friction_terms(frictions, table[rubbing], supports, times, known=known, obstacles=obstacles)
    return terms, obstacles, _contact_surface(table, drawn, terms, supports, times)
