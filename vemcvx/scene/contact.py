"""Contact limits and friction terms of a posed scene."""

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
from vemcvx.effects.data import read_finite, read_weights
from vemcvx.meshes import Interface
from vemcvx.meshes.polygons import find_all_in
from vemcvx.program.system import DRAG_ROUNDING, DraggedTerms, Limits, Norms
from vemcvx.scene.rows import (
    ContactRows,
    along,
    build_summation,
    distinct_pairs,
    merge_terms,
    pair_numbers,
    pairs_of,
    repeat_by_row,
    slices_of,
)
from vemcvx.scene.supports import Supports
from vemcvx.vem.projection import tangents_of

# A node on a contact boundary is a *contact node* in four cases. (1) The node can slide along the boundary. (2) It can
# move along the normal. (3) Contact prevents normal motion, and a support prevents tangential motion. (4) A support
# or a moving obstacle drags the node against friction. `Supports` defines the matrices A, H, P and the reactions R.

Moving = Callable[[float], Floats]
"""t -> displacement of the ground (the counter-surface), as vectors or tangential components"""


class Freedom(NamedTuple):
    """Masks (k,) of contact rows."""

    slides: Bools  # the node can slide along the boundary
    dragged: Bools  # supports prescribe a tangential displacement, and the slip changes
    normal_only: Bools  # the node cannot slide; its normal motion is free or held by contact


def _freedom(
    rows: ContactRows, tangents: Floats, supports: Supports, times: Sequence[float], ground: Moving | None = None
) -> Freedom:
    reads, per = rows.matrix(tangents, supports.points), tangents.shape[1]
    B = supports.on_free(reads)
    # Node i has the rows B_i of B. B_i B_i' is singular if supports prescribe a tangential displacement.
    parts = [B[axis::per] for axis in range(per)]
    products = np.array([[np.asarray(one.multiply(other).sum(axis=1)).ravel() for other in parts] for one in parts])
    each = np.linalg.eigvalsh(products.transpose(2, 0, 1))
    slides, held = each[:, -1] > 0, np.flatnonzero(each[:, 0] <= SAME * each[:, -1])
    dragged, normal_only = np.zeros(len(rows), dtype=bool), np.zeros(len(rows), dtype=bool)
    if len(held) and not (supports.still and ground is None):
        B_held = reads[(held[:, None] * per + np.arange(per)).ravel()]

        def slip(t: float) -> Floats:
            return B_held @ supports.motion(t) - (0.0 if ground is None else along(tangents[held], ground(t)[held]))

        dragged[held] = _find_dragged(slip, rows[held], supports, times, ground is not None)
    if not slides.all():
        normal_only = ~slides & (_normal_is_free(rows, supports) | _match_normals(rows, supports)[0])
    return Freedom(slides, dragged, normal_only)


def _normal_is_free(rows: ContactRows, supports: Supports) -> Bools:
    return np.diff(supports.on_free(rows.normal_rows(supports.points)).indptr) > 0


def _find_dragged(
    slip: Moving, rows: ContactRows, supports: Supports, times: Sequence[float], ground_moves: bool
) -> Bools:
    if len(times) == 0:
        nodes = supports.moved // supports.points.shape[1]
        return np.isin(rows.nodes, nodes) | np.isin(rows.partners, nodes) | ground_moves
    dragged = np.zeros(len(rows), dtype=bool)
    try:
        start = slip(float(times[0]))
        for t in times[1:]:
            at = slip(float(t))
            size = max(np.abs(at).max(), np.abs(start).max())
            dragged |= (np.abs(at - start) > DRAG_ROUNDING * size).reshape(len(rows), -1).any(axis=1)
    except VemcvxError:
        return np.ones(len(rows), dtype=bool)  # The step that evaluates these data raises the error.
    return dragged


def _normal_reactions(rows: ContactRows, supports: Supports) -> sp.csr_matrix:
    """Return rows g such that -g . R are the normal contact forces."""
    entries, places = _match_normals(rows, supports)[1:]
    return sp.csr_matrix(sp.csr_matrix((entries, places), shape=(len(rows), len(supports.depends))) @ supports.H.T)


def _match_normals(rows: ContactRows, supports: Supports) -> tuple[Bools, Floats, tuple[Ints, Ints]]:
    """Return a mask of rows held by contact, and entries of `_normal_reactions`."""
    (nodes, partners), holds = pairs_of(supports.given), np.flatnonzero(~supports.depends)
    directions = np.concatenate([supports.points[:0], *(support.directions for support in supports.given)])[holds]
    contact = repeat_by_row(supports.given, [support.contact for support in supports.given])[holds].astype(bool)
    nodes, partners = nodes[holds], partners[holds]
    # Match contact rows with rows of A at the same node or pair of nodes.
    wanted, known = (
        pair_numbers(np.maximum(*pair), np.minimum(*pair), len(supports.points))
        for pair in ((rows.nodes, rows.partners), (nodes, partners))
    )
    row, col = find_all_in(known, wanted)
    cosine = np.einsum("ij,ij->i", directions[col], rows.normals[row])
    same = np.linalg.norm(directions[col] - cosine[:, None] * rows.normals[row], axis=1) < SAME
    row, col, cosine = row[same], col[same], cosine[same] * np.where(nodes[col] == rows.nodes[row], 1.0, -1.0)[same]
    site, mine, size = supports.sites[nodes], supports.sites[rows.nodes], len(supports.sites)
    count, of_contact = np.bincount(site, minlength=size)[mine], np.bincount(site[contact], minlength=size)[mine]
    held_by_contact = np.zeros(len(rows), dtype=bool)
    held_by_contact[row[contact[col]]] = True
    takes = contact[col] | (count[row] == 1)
    # A corner node that contact holds in several directions is not a contact node.
    return held_by_contact & (of_contact == 1), cosine[takes], (row[takes], holds[col[takes]])


# Friction rows with the same node, normal and kind (`_kinds`) form one term. The weights of these rows are added.
# The matrix B^ maps nodal displacements to slips. The matrix over free unknowns is B = B^ P.
@dataclass(frozen=True, kw_only=True)
class Terms(ContactRows):
    """The friction terms of a posed scene. The first `acting` terms depend on free unknowns."""

    rows: sp.csr_matrix  # (m * (dim - 1), n_u) the matrix B^
    tangents: Floats  # (m, dim - 1, dim) orthonormal; the second is zero if a direction is given
    directed: Bools  # (m,) mask of terms along given directions
    frictions: Sequence[Friction]
    gather: sp.csr_matrix  # (m, rows) the matrix that sums rows to terms
    acting: int = 0  # number of terms with free unknowns
    dragged: Bools | None = None  # (m,) as in `Freedom`
    ground: Callable[[float], Floats] | None = None  # t -> (m * (dim - 1),) tangential ground motion since times[0]
    reported: Callable[[float], Floats] | None = None  # t -> (m, dim) the same motion as vectors
    press: sp.csr_matrix | None = None  # (rows, r) the map from normal contact forces to forces on friction rows

    def weights(self, t: float) -> Floats:
        """Return the weights (m,) at the instant `t`."""
        at, own = f"weights at t = {t:.6g}", self.frictions
        each = (read_weights(f.weights(t), len(f.nodes), f"{f.subject}: {at}") for f in own)
        return self.gather @ np.concatenate([np.zeros(0), *each])

    @property
    def block(self) -> int:
        """The number of components of a term."""
        return self.tangents.shape[1]

    @property
    def acting_rows(self) -> sp.csr_matrix:
        """The rows of acting terms in B^."""
        return self.rows[: self.acting * self.block]

    def norms(self, supports: Supports) -> Norms | None:
        """Return the acting terms, or None."""
        m, block, ground = self.acting, self.block, self.ground
        if m == 0:
            return None
        return Norms(
            B=supports.on_free(self.acting_rows),
            w=lambda t: self.weights(t)[:m],
            block=block,
            places=supports.places(self.nodes),
            law=self.law_of(slice(0, m)),
            ground=None if ground is None else lambda t: ground(t)[: m * block],
        )

    def immovable_terms(self, supports: Supports) -> DraggedTerms | None:
        """Return the terms that are not acting, or None."""
        m, block, ground = self.acting, self.block, self.ground
        if m == len(self):
            return None
        rows, law = self.rows[m * block :], self.law_of(slice(m, len(self)))
        weights: Callable[..., Any] = (lambda t, p, past, slip: self.weights(t)[m:]) if law is None else law.weights
        return DraggedTerms(
            position=lambda t: rows @ supports.motion(t) - (0.0 if ground is None else ground(t)[m * block :]),
            weights=weights,
            count=len(self) - m,
            block=block,
            rates=law is not None and law.rates,
        )

    def law_of(self, some: slice) -> Law | None:
        """Return the friction law of some terms, or None."""
        frictions, gather, press = self.frictions, sp.csr_matrix(self.gather[some]), self.press
        laws = [f.law for f in frictions if f.law is not None]
        if press is None or not laws:
            return None
        slips, rates = (any(getattr(law, name) for law in laws) for name in ("slips", "rates"))
        if rates and not all(law.rates or not law.slips for law in laws):
            raise SceneError("friction: found laws of slips and laws of slip rates; a scene has laws of one kind.")
        still = np.zeros(gather.shape[1])
        spread, own = gather.T, slices_of(frictions)

        def each(p: Floats, *of_terms: Floats) -> Iterable[tuple[Friction, list[Floats]]]:
            by_row = [press @ p, *(spread @ slip if slips else still for slip in of_terms)]
            return [(f, [values[rows] for values in by_row]) for f, rows in zip(frictions, own, strict=True)]

        def weights(t: float, p: Floats, past: Floats, slip: Floats) -> Floats:
            return gather @ np.concatenate([f.weights_under(t, *under) for f, under in each(p, past, slip)])

        def slope(t: float, p: Floats, past: Floats) -> sp.csr_matrix:
            steep = np.concatenate([f.slope_under(t, *under) for f, under in each(p, past)])
            entries = press.data * np.repeat(steep, np.diff(press.indptr))
            return sp.csr_matrix(gather @ sp.csr_matrix((entries, press.indices, press.indptr), shape=press.shape))

        soft = all(law.softening is not None for law in laws)
        softening = gather @ np.concatenate([f.softening for f in frictions]) if soft else None
        known = all(law.slope is not None for law in laws)
        pressed = any(law.pressed for law in laws)
        return Law(weights, softening, pressed, slope=slope if known else None, slips=slips, rates=rates)


def _friction_terms(
    frictions: Sequence[Friction],
    table: ContactRows,
    supports: Supports,
    times: Sequence[float],
    obstacles: Obstacles,
) -> Terms:
    points = supports.points
    normals = np.concatenate([points[:0], *(f.across for f in frictions)])
    each = np.concatenate([tangents_of(points[:0]), *(f.tangents for f in frictions)])
    first, term = merge_terms((table.nodes, table.partners), normals, kinds=_kinds(frictions))
    every, tangents, under = replace(table, normals=normals).merge(first, term), each[first], None
    if any(f.ground is not None for f in frictions):
        under = partial(_ground_motion, frictions, first)
        _refuse_overlap(frictions, table.ends, every.ends)
    held = _freedom(every, tangents, supports, times, under)
    acting = np.flatnonzero(held.slides)
    kept = np.concatenate([acting, np.flatnonzero((held.normal_only | held.dragged) & ~held.slides)])
    rows, tangents = every[kept], tangents[kept]
    moves = None if under is None or not len(kept) else partial(_ground_motion, frictions, first[kept])
    ground = None if moves is None else _since(tangents, moves, times)
    return Terms(
        **rows.columns,
        rows=rows.matrix(tangents, points),
        tangents=tangents,
        directed=repeat_by_row(frictions, [f.directions is not None for f in frictions]).astype(bool)[first][kept],
        frictions=frictions,
        gather=build_summation(term, len(first))[kept],
        acting=len(acting),
        dragged=held.dragged[kept],
        ground=ground,
        reported=ground and (lambda t: np.einsum("mb,mbd->md", ground(t).reshape(tangents.shape[:2]), tangents)),
        press=_pressures(frictions, table, obstacles, supports) if len(kept) else None,
    )


def _kinds(frictions: Sequence[Friction]) -> Ints:
    kinds = [(f.ground and id(f.ground.value), f.directions is not None and not f.in_plane) for f in frictions]
    return repeat_by_row(frictions, [kinds.index(kind) for kind in kinds])


def _ground_motion(frictions: Sequence[Friction], rows: Ints, t: float) -> Floats:
    each = [np.zeros(f.normals.shape) if f.ground is None else f.ground.vector(t) for f in frictions]
    return np.concatenate(each)[rows]


def _since(tangents: Floats, moved: Moving, times: Sequence[float]) -> Moving:
    start = along(tangents, moved(float(times[0]))) if len(times) else 0.0
    return lambda t: along(tangents, moved(t)) - start


def _refuse_overlap(frictions: Sequence[Friction], owns: sp.csr_matrix, ends: sp.csr_matrix) -> None:
    """Raise SceneError if frictions with different ground motions share an edge."""
    twice = np.flatnonzero(np.bincount(ends.indices, minlength=ends.shape[1]) > 1)
    if len(twice):
        owner = repeat_by_row(frictions, range(len(frictions)))
        one, other = np.unique(owner[owns[:, twice[:1]].nonzero()[0]])[:2]
        both = f"{frictions[one].subject} and {frictions[other].subject}"
        raise SceneError(f"{both}: they act on the same edges, but ground= differs. Give both the same ground=.")


def warn_of_free_normals(
    frictions: Sequence[Friction], supports: Supports, obstacles: Obstacles, springs: sp.csr_matrix | None
) -> None:
    """Warn if nothing holds the body along the normal of a friction boundary."""
    sprung = [] if springs is None else [np.flatnonzero(springs.diagonal() > 0) // supports.points.shape[1]]
    stopped = np.concatenate([obstacles.nodes, *sprung, *(f.nodes for f in frictions if f.directions is not None)])
    for friction in frictions:
        law = friction.law
        if (law is not None and law.pressed) or friction.directions is not None:
            continue
        rows = ContactRows.from_parts([friction], supports.points.shape[1])
        free = _normal_is_free(rows, supports) & ~np.isin(friction.nodes, stopped)
        if free.any():
            warnings.warn(
                f"{friction.subject}: at {free.sum()} of {len(free)} places nothing holds the body in the normal "
                "direction; add BilateralContact on the same boundary, unless the body may move freely there.",
                SceneWarning,
                stacklevel=2,
            )


@dataclass(frozen=True, kw_only=True)
class Surface(ContactRows):
    """The contact nodes in ascending order. Corner nodes have mean normals."""

    normal_reaction: sp.csr_matrix  # (m, n_u) rows g; normal contact forces are -g . R


def _contact_surface(
    table: ContactRows, moves: Bools, terms: Terms, supports: Supports, times: Sequence[float]
) -> Surface:
    first, row = merge_terms((table.nodes, table.partners), table.normals)
    every = table.merge(first, row)
    held = _freedom(every, tangents_of(every.normals), supports, times)
    drawn = np.zeros(len(first), dtype=bool)
    np.logical_or.at(drawn, row, moves)
    rubs = (held.dragged | drawn) & (terms[terms.acting :].find(every) >= 0)
    kept = np.flatnonzero(held.slides | held.normal_only | rubs)
    rows = every[kept]
    lead, place = distinct_pairs(rows.nodes, rows.partners)
    together = build_summation(place, len(lead))
    surface = replace(rows[lead], normals=together @ (rows.lengths[:, None] * rows.normals), ends=together @ rows.ends)
    unit = surface.normals / np.linalg.norm(surface.normals, axis=1)[:, None]
    reaction = sp.csr_matrix(together @ _normal_reactions(rows, supports))
    return Surface(**replace(surface, normals=unit).columns, normal_reaction=reaction)


# Rigid obstacles at the same node with the same normal are merged. The merged limit has the least gap.
@dataclass(frozen=True, kw_only=True)
class Obstacles(ContactRows):
    """The contact limits of a posed scene, one per row."""

    rows: sp.csr_matrix  # (r, n_u) the map from displacements to normal displacements or jumps
    compliance: Floats
    rates: Bools  # (r,) mask of limits on velocities
    gap: Callable[[float], Floats]  # t -> (r,)
    subjects: tuple[str, ...] = ()  # descriptions of the obstacles, for messages
    prescribed: Obstacles | None = None  # rows whose normal displacements are prescribed by supports

    def limits(self, supports: Supports) -> Limits | None:
        """Return the limits over the free unknowns, or None."""
        if len(self) == 0:
            return None
        return Limits(
            supports.on_free(self.rows), self.gap, self.compliance, places=supports.places(self.nodes), rates=self.rates
        )


def _obstacles(obstacles: Sequence[Obstacle], table: ContactRows, supports: Supports) -> Obstacles:
    points = supports.points
    each = (read_finite(o.compliance, len(o.nodes), f"{o.subject}: compliance") for o in obstacles)
    compliance = np.concatenate([np.zeros(0), *each])
    rates = repeat_by_row(obstacles, [o.rates for o in obstacles]).astype(bool)
    kinds = np.where((compliance == 0) & ~rates, -1, np.arange(len(table)))
    lead, place = merge_terms((table.nodes, table.partners), table.normals, signed=True, kinds=kinds)
    first, limit = np.sort(lead), np.argsort(np.argsort(lead))[place]
    every = table.merge(first, limit)
    rows = every.normal_rows(points)
    moves = np.diff(supports.on_free(rows).indptr) > 0
    # Negative gaps above -rounding are rounding errors of coordinates.
    rounding = 4 * EPS * float(np.abs(points).max())

    def select(chosen: Ints) -> Obstacles:
        def gap(t: float) -> Floats:
            nearest = np.full(len(first), np.inf)
            gaps = [read_finite(o.gap(t), len(o.nodes), f"{o.subject}: gap at t = {t:.6g}") for o in obstacles]
            np.minimum.at(nearest, limit, np.concatenate([nearest[:0], *gaps]))
            return np.where((-rounding <= nearest) & (nearest < 0), 0.0, nearest)[chosen]

        return Obstacles(
            **every[chosen].columns,
            rows=sp.csr_matrix(rows[chosen]),
            compliance=compliance[first][chosen],
            rates=rates[first][chosen],
            gap=gap,
            subjects=tuple(o.subject for o in obstacles),
        )

    return replace(select(np.flatnonzero(moves)), prescribed=None if moves.all() else select(np.flatnonzero(~moves)))


def _pressures(
    frictions: Sequence[Friction], table: ContactRows, obstacles: Obstacles, supports: Supports
) -> sp.csr_matrix | None:
    """Return the matrix that maps normal contact forces to forces on friction rows."""
    if all(f.law is None for f in frictions):
        return None
    reads = repeat_by_row(frictions, [f.law is not None and f.law.pressed for f in frictions]).astype(bool)
    shares = sp.csr_matrix(sp.diags_array(reads.astype(float)) @ table.shares(obstacles))
    shares.eliminate_zeros()
    bare = reads & (np.diff(shares.indptr) == 0) & (_normal_is_free(table, supports) | (len(obstacles) == 0))
    for f, rows in zip(frictions, slices_of(frictions), strict=True):
        if bare[rows].any():
            raise SceneError(
                f"{f.subject}: no pressure is known at {bare[rows].sum()} of {len(f.nodes)} places. Add "
                "UnilateralContact or NormalCompliance on the same boundary."
            )
    return shares


def find_missing_contact(interfaces: Mapping[str, Interface], parts: Sequence[ContactSurface | Support]) -> list[str]:
    """Return a warning for each interface without contact."""
    nodes, partners = pairs_of(parts)
    met = nodes[partners >= 0]
    return [
        f"interface {name!r}: no contact acts on it, so that {' and '.join(interface.bodies)} may overlap. "
        f"If they touch there, add a contact effect with on={name!r}."
        for name, interface in interfaces.items()
        if not np.isin(interface.pairs, met).any()
    ]


def pose_contact(
    surfaces: Sequence[ContactSurface],
    frictions: Sequence[Friction],
    stops: Sequence[Obstacle],
    supports: Supports,
    times: Sequence[float],
) -> tuple[Terms, Obstacles, Surface]:
    """Return the friction terms, the limits, and the contact nodes."""
    table = ContactRows.from_parts([*surfaces, *frictions, *stops], supports.points.shape[1])
    start, count = sum(len(s.nodes) for s in surfaces), sum(len(f.nodes) for f in frictions)
    rubbing, drawn = slice(start, start + count), np.zeros(len(table), dtype=bool)
    drawn[rubbing] = repeat_by_row(frictions, [f.ground is not None for f in frictions])
    obstacles = _obstacles(stops, table[rubbing.stop :], supports)
    terms = _friction_terms(frictions, table[rubbing], supports, times, obstacles)
    return terms, obstacles, _contact_surface(table, drawn, terms, supports, times)
