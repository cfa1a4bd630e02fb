"""Floating bodies: the rigid motions that no support resists.

Let A be the stiffness of a body without supports. The k columns of R are the rigid motions. The loads f balance if
R'f = 0. Then A u = f has a solution. *Pins* set k nodal values to zero. They make u unique and bear no force.
Results do not contain the mean rigid motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from vemcvx.vem import Space
from vemcvx.vem.boundary import DIRECTION_TOLERANCE
from vemcvx.vem.elasticity import rigid_modes, split_motion


def body_names(mesh: Mesh, piece: Ints, node: Ints) -> list[str | None]:
    """Return a body name or None for each connected piece."""
    found: list[set[str]] = [set() for _ in range(piece.max() + 1)]
    for joint in mesh.interfaces.values():
        for body, ends in zip(joint.bodies, (joint.edges, joint.partners), strict=True):
            for one in np.unique(piece[np.isin(node, ends)]):
                found[one].add(body)
    return [names.pop() if len(names) == 1 else None for names in found]


def describe_motion(mode: Floats, which: str, bodies: list[str | None], axes: Floats, directed: bool = False) -> str:
    """Return a rigid motion in words."""
    mode = mode if directed else mode * np.sign(mode[np.argmax(np.abs(mode))])
    each = mode.reshape(len(bodies), -1)
    large = np.flatnonzero(np.abs(each).max(axis=1) > DIRECTION_TOLERANCE * np.abs(mode).max())
    names = [bodies[one] or (which if len(bodies) == 1 else None) for one in large]
    if None in names or len(set(names)) < len(names):
        return f"a motion of several connected pieces of {which}"
    own = zip(large, names, strict=True)
    return " with ".join(f"{_describe_rigid(axes[one] @ each[one], directed)} of {name}" for one, name in own)


def _describe_rigid(mode: Floats, directed: bool) -> str:
    move, turn = split_motion(np.asarray(np.round(mode / np.linalg.norm(mode), 6) + 0.0))
    rate, turns = np.linalg.norm(turn), "a rotation"
    if rate > DIRECTION_TOLERANCE and len(turn) > 1:
        turns = f"a rotation about {coordinates(turn / rate, 2)}"
    elif directed:
        turns = "an anticlockwise rotation" if turn[0] > 0 else "a clockwise rotation"
    if rate > 0.9:
        return turns
    return f"the translation {coordinates(move, 2)}" + (f" with {turns}" if rate >= DIRECTION_TOLERANCE else "")


# A piece is a set of cells joined along edges, in space along faces. Pieces may share single nodes. R_q c_q is a rigid
# motion of piece q. The diagonal matrix W has the number of pieces at each node. If a support or a joint connects two
# nodes, we assume that W is equal at both. F is the stiffness of springs. The displacements v = P y fulfil the
# supports. The squared distance between the motions R_q c_q and the nearest v is
#
#     sum_q |R_q c_q|^2 - |P'W^{-1/2} sum_q R_q c_q|^2.
#
# The body floats if this distance and v'Fv are zero for some c != 0.
FREE_FRACTION = 1e-12
"""The relative squared distance below which a motion is free."""


def floating_motions(
    space: Space, supports: Supports, felt: sp.csr_matrix, springs: sp.csr_matrix | None = None
) -> tuple[Kernel | None, bool]:
    """Return the motions that only the contact rows in `felt` resist."""
    (piece, node), points = space.pieces, space.mesh.points
    count, dim = np.bincount(node, minlength=len(points)), points.shape[1]
    R, axes = _motions(piece, node, points)
    k = axes.shape[1]
    free = supports.gather(sp.csr_matrix(sp.diags_array(np.repeat(count**-0.5, dim)) @ R))
    if space.axisymmetric:  # Only translations along the axis cause no strain.
        free = sp.csr_matrix(free @ sp.diags_array(np.tile([0.0, 1.0, 0.0], len(axes))))
    kept = sp.csr_matrix(free.T @ free)
    parts, label = _connect(piece, node, supports.linked, springs)
    bodies = body_names(space.mesh, piece, node)
    # Rounding errors of coordinates tilt contact normals.
    rounding = (64 * EPS) * max(1.0, np.abs(points).max() / space.mesh.h)
    modes, names, named = list[Floats](), list[str](), True
    described = list[tuple[Callable[..., str], Floats]]()
    for number in range(parts):
        own = np.flatnonzero(label == number)
        columns = (own[:, None] * k + np.arange(k)).ravel()
        value, vector = np.linalg.eigh(np.eye(len(columns)) - kept[columns][:, columns].toarray())
        loose = vector[:, value < FREE_FRACTION * k]
        fields = supports.P.T @ sp.diags_array(np.repeat(1.0 / count, dim)) @ R[:, columns]
        if springs is not None and loose.shape[1] > 0:
            loose = loose @ _without_energy(springs, supports.P @ (fields @ loose))
        if loose.shape[1] == 0:
            continue
        loose = _along_axes(loose)
        loose = np.where(np.abs(loose) > rounding * np.abs(loose).max(axis=0), loose, 0.0)
        field = fields @ loose
        which = f"part {number + 1} of {parts} of the body" if parts > 1 else "the body"
        of_pieces = [bodies[one] for one in own]
        describe = partial(describe_motion, which=which, bodies=of_pieces, axes=axes[own])
        _refuse_floating(which, describe, loose, felt @ field, rounding * np.abs(felt.data).max(initial=0.0))
        size = np.abs(field).max(axis=0)
        modes.append(field / size)
        names += map(describe, loose.T)
        described.append((describe, loose / size))
        named = named and None not in of_pieces
    if not modes:
        return None, False

    def in_words(c: Floats) -> str:
        of_parts = np.split(c, np.cumsum([motions.shape[1] for _, motions in described])[:-1])
        moves = [(describe, motions @ own) for (describe, motions), own in zip(described, of_parts, strict=True)]
        least = DIRECTION_TOLERANCE * max(np.abs(move).max() for _, move in moves)
        return " and ".join(describe(move, directed=True) for describe, move in moves if np.abs(move).max() > least)

    moved = (supports.P @ np.hstack(modes)).reshape(len(count), dim, -1)
    return Kernel(np.hstack(modes), tuple(names), in_words, moved), named


def _refuse_floating(
    which: str, describe: Callable[[Floats], str], loose: Floats, felt: Floats, rounding: float
) -> None:
    _, size, rotated = np.linalg.svd(felt, full_matrices=len(felt) < loose.shape[1])
    least = max(FREE_FRACTION**0.5 * size.max(initial=0.0), rounding)
    unfelt = loose @ rotated[int((size > least).sum()) :].T
    count = unfelt.shape[1]
    if count == 0:
        return
    free, first = ("1 rigid motion", ":") if count == 1 else (f"{count} rigid motions", "; the first is")
    raise SceneError(
        f"supports: {which} floats: neither a support nor friction prevents {free}{first} "
        f"{describe(_along_axes(unfelt)[:, 0])}. Add Clamp, PrescribedDisplacement or BilateralContact where they "
        "prevent this motion. Friction prevents only sliding along its boundary. A load prevents no motion."
    )


def find_pins(parts: Sequence[Support | ContactSurface], points: Floats) -> tuple[Support, ...]:
    """Return the pins, or () if the body has supports."""
    nodes, partners = pairs_of(parts)
    if (partners < 0).any():
        return ()
    dim, apart = points.shape[1], np.setdiff1d(np.arange(len(points)), np.append(nodes, partners))
    modes = rigid_modes((points - points.mean(axis=0))[apart] / np.ptp(points, axis=0).max())
    values = qr(modes.T, mode="r", pivoting=True)[1][: modes.shape[1]]
    pinned = apart[values // dim]
    return (Support("supports", pinned, np.eye(dim)[values % dim], points[pinned]),)


def check_balance(force: Callable[[float], Floats], points: Floats, times: Sequence[float]) -> None:
    """Raise SceneError if the loads do not balance at one of `times`."""
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
                "BilateralContact where the body is held, or add the missing loads."
            )


def build_body_frame(space: Space) -> Callable[[Floats], Floats]:
    """Return a function that removes the rigid motion of each body from a field."""

    @cache
    def motions() -> sp.csr_matrix:
        (piece, node), every = space.pieces, np.arange(space.mesh.n_nodes)
        body = every.copy()
        body[node] = _connect(piece, node, every, None)[1][piece]
        by_body = np.argsort(body, kind="stable")
        return _motions(body[by_body], by_body, space.mesh.points)[0]

    return lambda u: u - motions() @ (motions().T @ u)


def _along_axes(loose: Floats) -> Floats:
    """Return an orthonormal basis of range(loose), preferably along axes."""
    preferred = 1.0 - 1e-2 * np.arange(len(loose)) / len(loose)
    Q = qr(loose @ loose.T * preferred, pivoting=True)[0][:, : loose.shape[1]]
    return Q * np.sign(Q[np.argmax(np.abs(Q), axis=0), np.arange(Q.shape[1])])


def _without_energy(springs: sp.csr_matrix, fields: Floats) -> Floats:
    """Return orthonormal combinations of `fields` that do not strain the springs."""
    size = np.abs(fields).max(axis=0)
    energy, rotated = np.linalg.eigh((fields / size).T @ (springs @ (fields / size)))
    free = rotated[:, energy <= FREE_FRACTION * max(np.abs(springs.data).max(initial=0.0), energy[-1])]
    return np.linalg.qr(free / size[:, None])[0]


def _connect(piece: Ints, node: Ints, sites: Ints, springs: sp.csr_matrix | None) -> tuple[int, Ints]:
    """Return the number of connected parts, and the part of each piece."""
    pieces = piece.max() + 1
    links = np.column_stack([piece, pieces + sites[node]])
    if springs is not None:
        ends = np.column_stack(springs.nonzero()) // (springs.shape[0] // len(sites))
        links = np.concatenate([links, pieces + sites[ends]])
    first, part = np.unique(smallest_linked(links, pieces + sites.max() + 1)[:pieces], return_inverse=True)
    return len(first), part


def _motions(piece: Ints, node: Ints, points: Floats) -> tuple[sp.csr_matrix, Floats]:
    """Return orthonormal rigid motions of pieces."""
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
    # Scale all rotations of a piece equally.
    turns = norm[:, dim:].mean(axis=1, keepdims=True) / norm[:, dim:]
    axes = np.hstack([np.ones((pieces, dim)), turns])[:, :, None] * np.eye(k)
    # Only rotations about the principal axes of inertia are orthogonal.
    if np.abs(products - np.eye(k)).max() > 1e-9:
        orthonormal = np.linalg.inv(np.linalg.cholesky(products)).swapaxes(1, 2)
        modes, axes = modes @ orthonormal[piece], axes @ orthonormal
    rows = np.repeat(node[:, None] * dim + np.arange(dim), k, axis=1)
    columns = np.tile(piece[:, None] * k + np.arange(k), (1, dim))
    R = sp.csr_matrix((modes.ravel(), (rows.ravel(), columns.ravel())), shape=(points.size, pieces * k))
    return R, axes
