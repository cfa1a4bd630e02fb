"""Bodies that float: motions without strain that no support resists, found and said in words.

A body that nothing holds at all has an answer where its loads balance: R'f(t) = 0 for its rigid motions R (n_u, k). The
answer is unique but for a rigid motion. k nodal values, such that R is regular there, are held at zero (*pins*). That
chooses one answer, and takes no force: R'(A u - f) = 0, so that the forces r of pins obey R'r = 0, r = 0. Results are
the answer without its mean rigid motion (:mod:`vemcvx.results.results`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial

import numpy as np
import scipy.sparse as sp
from scipy.linalg import qr

from vemcvx.base.arrays import EPS, SAME, Floats, Ints
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import coordinates
from vemcvx.effects import ContactSurface, Support
from vemcvx.meshes import Mesh
from vemcvx.meshes.polygons import smallest_linked
from vemcvx.program.kernel import Kernel
from vemcvx.scene.rows import pairs_of
from vemcvx.scene.supports import Supports
from vemcvx.vem import Space, rigid_modes, split_motion
from vemcvx.vem.boundary import DIRECTION_TOLERANCE


def body_names(mesh: Mesh, piece: Ints, node: Ints) -> list[str | None]:
    """The body of each piece, of pairs of piece and node, by the interfaces it touches; None if unclear."""
    found: list[set[str]] = [set() for _ in range(piece.max() + 1)]
    for joint in mesh.interfaces.values():
        for body, ends in zip(joint.bodies, (joint.edges, joint.partners), strict=True):
            for one in np.unique(piece[np.isin(node, ends)]):
                found[one].add(body)
    return [names.pop() if len(names) == 1 else None for names in found]


@dataclass(frozen=True)
class Part:
    """A part of what is in a scene: pieces that supports, contact or springs join, and how it is called."""

    which: str
    bodies: tuple[str | None, ...]  #: the names of its pieces
    hinge: str  #: a node at which pieces are joined, in words; empty without
    axes: Floats  #: (pieces, k, k) the motions of each along the axes and about them, of its orthonormal ones

    def motion(self, mode: Floats, directed: bool = False) -> str:
        """Return a motion in words, and whose it is; which way it goes if it is `directed`."""
        mode = mode if directed else mode * np.sign(mode[np.argmax(np.abs(mode))])
        each = mode.reshape(len(self.bodies), -1)
        large = np.flatnonzero(np.abs(each).max(axis=1) > DIRECTION_TOLERANCE * np.abs(mode).max())
        names = [self.bodies[one] or (self.which if len(self.bodies) == 1 else None) for one in large]
        if self.hinge:
            return f"a motion about hinges, such as {self.hinge}, of {self.which}"
        if None in names or len(set(names)) < len(names):
            return f"a motion of pieces that are joined, of {self.which}"
        own = zip(large, names, strict=True)
        return " with ".join(f"{_rigid(self.axes[one] @ each[one], directed)} of {name}" for one, name in own)


def combined(motions: Sequence[tuple[Part, Floats]], c: Floats) -> str:
    """Return a combination of motions in words, part by part, and which way it goes."""
    parts: dict[str, tuple[Part, Floats]] = {}
    for share, (part, motion) in zip(c, motions, strict=True):
        before = parts[part.which][1] if part.which in parts else 0.0
        parts[part.which] = part, before + share * motion
    largest = max(np.abs(motion).max() for _, motion in parts.values())
    large = [(part, motion) for part, motion in parts.values() if np.abs(motion).max() > DIRECTION_TOLERANCE * largest]
    return " and ".join(part.motion(motion, directed=True) for part, motion in large)


def _rigid(mode: Floats, directed: bool) -> str:
    """Return a rigid motion in words: a translation, a rotation, or both."""
    move, turn = split_motion(np.asarray(np.round(mode / np.linalg.norm(mode), 6) + 0.0))
    rate, turns = np.linalg.norm(turn), "a rotation"
    if rate > DIRECTION_TOLERANCE and len(turn) > 1:
        turns = f"a rotation about ({_listed(turn / rate)})"
    elif directed:
        turns = "an anticlockwise rotation" if turn[0] > 0 else "a clockwise rotation"
    if rate > 0.9:
        return turns
    return f"the translation ({_listed(move)})" + (f" with {turns}" if rate >= DIRECTION_TOLERANCE else "")


def _listed(components: Floats) -> str:
    return ", ".join(f"{component:.2g}" for component in components)


# A piece of the body is made of cells joined along edges, in space along faces; without strain it moves as a rigid
# body. Pieces that share single nodes only are hinged there. With c the rigid motion of every piece and R_q c_q its
# nodal values, the distance to the nearest admissible field, the same at every node for all pieces there and obeying
# the supports, is
#
#     sum_q |R_q c_q|^2 - |W^{-1/2} P'sum_q R_q c_q|^2,    W = number of pieces at a node,
#
# and the body floats if and only if this vanishes for some c. Of one piece it is the part of c that meets a support.
# Springs to the ground of matrix F hold what they feel: of the fields v with vanishing distance, v'Fv = 0 float.


# A motion is free when less than this part of it (squared) meets a support; one clamped node of a million leaves 1e-6.
FREE = 1e-12


def floating_motions(
    space: Space, supports: Supports, felt: Sequence[sp.csr_matrix], springs: sp.csr_matrix | None = None
) -> tuple[Kernel | None, bool]:
    """Return the motions without strain that no support resists but friction does; None if there are none.

    Besides, whether all are of bodies that interfaces touch: to be held by contact is the normal case there. `felt`
    are matrices (rows, n) of norm terms and limits. SceneError names a motion that meets none of these.
    """
    piece, node = space.pieces
    count = np.bincount(node, minlength=space.mesh.n_nodes)
    R, axes = _motions(piece, node, space.mesh.points)
    k, dim = R.shape[1] // (piece.max() + 1), space.mesh.points.shape[1]
    free = supports.gather(sp.csr_matrix(sp.diags_array(np.repeat(count**-0.5, dim)) @ R))
    kept = sp.csr_matrix(free.T @ free)
    parts, label = _connected(piece, node, supports.linked, springs)
    bodies = body_names(space.mesh, piece, node)
    fields_of, motions = [], list[tuple[Part, Floats]]()
    # Sides of length h at a distance of D from the origin have directions known to EPS D / h.
    rounding = (64 * EPS) * max(1.0, np.abs(space.mesh.points).max() / space.mesh.h)
    largest = max((np.abs(rows.data).max(initial=0.0) for rows in felt), default=0.0)
    for number in range(parts):
        own = np.flatnonzero(label == number)
        columns = (own[:, None] * k + np.arange(k)).ravel()
        value, vector = np.linalg.eigh(np.eye(len(columns)) - kept[columns][:, columns].toarray())
        loose = vector[:, value < FREE * k]
        fields = supports.P.T @ sp.diags_array(np.repeat(1.0 / count, dim)) @ R[:, columns]
        if springs is not None and loose.shape[1] > 0:
            loose = loose @ _without_energy(springs, supports.P @ (fields @ loose))
        if loose.shape[1] == 0:
            continue
        which = f"part {number + 1} of {parts} of the body" if parts > 1 else "the body"
        hinges = (i for i in np.flatnonzero(count > 1) if label[piece[node == i][0]] == number)
        hinge = next((f"node {i} at {space.mesh.points[i]}" for i in hinges), "")
        part = Part(which, tuple(bodies[one] for one in own), hinge, axes[own])
        loose = _along_axes(loose)
        # Below rounding there is nothing: a remainder of 1e-15 across a translation would press against contact.
        loose = np.where(np.abs(loose) > rounding * np.abs(loose).max(axis=0), loose, 0.0)
        field = fields @ loose
        rubbed = np.vstack([field[:0], *(rows @ field for rows in felt)])
        _, size, rotated = np.linalg.svd(rubbed, full_matrices=len(rubbed) < field.shape[1])
        # An orthonormal basis of what contact does not feel: where it feels nothing at all, sizes are all rounding.
        least = max(FREE**0.5 * size.max(initial=0.0), rounding * largest)
        unfelt = loose @ rotated[int((size > least).sum()) :].T
        if (free_motions := unfelt.shape[1]) > 0:
            motions_meet = "1 rigid motion meets" if free_motions == 1 else f"{free_motions} rigid motions meet"
            raise SceneError(
                f"supports: {which} floats: {motions_meet} neither a support nor friction, the first "
                f"{part.motion(_along_axes(unfelt)[:, 0])}. Add Clamp, PrescribedDisplacement or BilateralContact "
                "where they stop it; friction holds what slides along its boundary only, and loads hold nothing."
            )
        size = np.abs(field).max(axis=0)
        fields_of.append(field / size)
        motions += [(part, column) for column in (loose / size).T]
    if not motions:
        return None, False
    names = tuple(part.motion(mode) for part, mode in motions)
    named = all(None not in part.bodies for part, _ in motions)
    modes = np.hstack(fields_of)
    return Kernel(modes, names, partial(combined, motions), supports.P @ modes), named


def pins_of(parts: Sequence[Support | ContactSurface], points: Floats) -> tuple[Support, ...]:
    """Return the pins of a body with these supports, frictions and obstacles; none if one of them is on the ground.

    They are on nodes (of points (n_nodes, dim)) that no part touches.
    """
    nodes, partners = pairs_of(parts)
    if (partners < 0).any():
        return ()
    dim, apart = points.shape[1], np.setdiff1d(np.arange(len(points)), np.append(nodes, partners))
    modes = rigid_modes((points - points.mean(axis=0))[apart] / np.ptp(points, axis=0).max())
    values = qr(modes.T, mode="r", pivoting=True)[1][: modes.shape[1]]
    pinned = apart[values // dim]
    return (Support("supports", pinned, np.eye(dim)[values % dim], points[pinned]),)


def check_balance(force: Callable[[float], Floats], points: Floats, times: Sequence[float]) -> None:
    """Raise SceneError for loads, t -> (n_u,), of a body that nothing holds which are out of balance at an instant.

    Balanced is what is so to `SAME` of the sum of all sizes: to rounding.
    """
    centre = points.mean(axis=0)
    modes = rigid_modes(points - centre)
    for t in times:
        f = force(t)
        left, size = modes.T @ f, np.abs(modes).T @ np.abs(f)
        left = np.where(np.abs(left) > SAME * size, left, 0.0)
        if left.any():
            pull, turn = (coordinates(part) for part in split_motion(left))
            raise SceneError(
                f"supports: nothing holds the body, and its loads do not balance: at t = {t:.6g} their resultant is "
                f"{pull}, and their moment about {coordinates(centre)} is {turn}. Add Clamp, PrescribedDisplacement or "
                "BilateralContact where they hold it, or the loads that are missing."
            )


def seen_from_bodies(space: Space) -> Callable[[Floats], Floats]:
    """Return a function that takes from a field u (n_u,) its rigid part, body by body.

    What is left has the same strains, and is small where they are, however far the bodies have moved.
    """

    @cache
    def motions() -> tuple[sp.csr_matrix, sp.csr_matrix]:
        (piece, node), every = space.pieces, np.arange(space.mesh.n_nodes)
        body = every.copy()
        body[node] = _connected(piece, node, every, None)[1][piece]
        by_body = np.argsort(body, kind="stable")
        R, _ = _motions(body[by_body], by_body, space.mesh.points)
        return R, sp.csr_matrix(R.T)

    def seen(u: Floats) -> Floats:
        R, transposed = motions()
        return u - R @ (transposed @ u)

    return seen


def _along_axes(loose: Floats) -> Floats:
    """Return orthonormal columns of the same span, as near to single translations along axes, of single pieces, as can.

    Eigenvectors to one eigenvalue are mixed by rounding.
    """
    preferred = 1.0 - 1e-2 * np.arange(len(loose)) / len(loose)
    Q = qr(loose @ loose.T * preferred, pivoting=True)[0][:, : loose.shape[1]]
    return Q * np.sign(Q[np.argmax(np.abs(Q), axis=0), np.arange(Q.shape[1])])


def _without_energy(springs: sp.csr_matrix, fields: Floats) -> Floats:
    """Combinations of the columns, as orthonormal columns, to which springs give no energy."""
    size = np.abs(fields).max(axis=0)
    energy, rotated = np.linalg.eigh((fields / size).T @ (springs @ (fields / size)))
    free = rotated[:, energy <= FREE * max(np.abs(springs.data).max(initial=0.0), energy[-1])]
    return np.linalg.qr(free / size[:, None])[0]


def _connected(piece: Ints, node: Ints, sites: Ints, springs: sp.csr_matrix | None) -> tuple[int, Ints]:
    """The number of connected parts of the pieces, given as pairs of piece and node, and the part of each piece.

    They are connected at sites (n_nodes,) that they share, or that springs join.
    """
    pieces = piece.max() + 1
    links = np.column_stack([piece, pieces + sites[node]])
    if springs is not None:
        ends = np.column_stack(springs.nonzero()) // (springs.shape[0] // len(sites))
        links = np.concatenate([links, pieces + sites[ends]])
    first, part = np.unique(smallest_linked(links, pieces + sites.max() + 1)[:pieces], return_inverse=True)
    return len(first), part


def _motions(piece: Ints, node: Ints, points: Floats) -> tuple[sp.csr_matrix, Floats]:
    """(n_u, pieces * k) the k rigid motions of each piece as orthonormal columns, of pairs by piece and node.

    Taken about its middle and in units of its size: rotations then weigh like translations. Besides the matrices
    (pieces, k, k) that take their coefficients to those of translations along the axes and of rotations about them.
    """
    pieces, dim = piece.max() + 1, points.shape[1]
    inside = np.bincount(piece)
    middle = np.stack([np.bincount(piece, weights=x) / inside for x in points[node].T], axis=1)
    shifted = points[node] - middle[piece]
    begin = np.flatnonzero(np.diff(piece, prepend=-1))
    size = np.maximum.reduceat(np.abs(shifted), begin).max(axis=1)
    modes = rigid_modes(shifted / size[piece, None]).reshape(len(piece), dim, -1)
    k = modes.shape[2]
    products = np.stack([(own := one.reshape(-1, k)).T @ own for one in np.split(modes, begin[1:])])
    norm = np.sqrt(np.einsum("pkk->pk", products))
    modes /= norm[piece][:, None, :]
    products /= norm[:, :, None] * norm[:, None, :]
    # One factor for all rotations of a piece keeps the direction of their sum, and what they weigh.
    turns = norm[:, dim:].mean(axis=1, keepdims=True) / norm[:, dim:]
    axes = np.hstack([np.ones((pieces, dim)), turns])[:, :, None] * np.eye(k)
    # Rotations about different axes are not orthogonal unless these are axes of inertia; 1e-9 is above rounding.
    if np.abs(products - np.eye(k)).max() > 1e-9:
        orthonormal = np.linalg.inv(np.linalg.cholesky(products)).swapaxes(1, 2)
        modes, axes = modes @ orthonormal[piece], axes @ orthonormal
    rows = np.repeat(node[:, None] * dim + np.arange(dim), k, axis=1)
    columns = np.tile(piece[:, None] * k + np.arange(k), (1, dim))
    R = sp.csr_matrix((modes.ravel(), (rows.ravel(), columns.ravel())), shape=(points.size, pieces * k))
    return R, axes
