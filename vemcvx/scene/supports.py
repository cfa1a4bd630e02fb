"""Nodal constraints eliminated: u = P y + u_D(t), with P'P = I and the held part u_D orthogonal to P's range.

At each node the prescribed directions are orthonormalised in a fixed order (Gram-Schmidt): what is
prescribed first, then the normals of bilateral contact, then those that friction and obstacles refer to; the axes fill
the frame up. The first two kinds are held, the rest are the free unknowns y. A frame so chosen makes every
friction term touch its own unknowns alone, and sticking exactly representable: y_i = 0.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.arrays import Floats, Ints
from vemcvx.effects import Friction, Obstacle, Support
from vemcvx.errors import SceneError

Forces = TypeVar("Forces", Floats, sp.csr_matrix)

# Two directions closer than this are one: unit normals of straight sides agree to about 1e-15 h / |e|,
# and no mesh is meant to resolve corners of 1e-9 rad.
PARALLEL = 1e-9


@dataclass(frozen=True)
class Supports:
    """The free unknowns of a body, and the motion of the held ones."""

    P: sp.csr_matrix
    """(n_u, n) orthonormal columns, one a free unknown, ordered by node."""
    nodes: Ints
    """(n,) the node of each free unknown."""
    columns: Ints | None
    """(n,) positions in u when P merely selects (all frames are along the axes), else None."""
    rows: tuple[_Slot, ...]
    points: Floats
    _last: dict[float, Floats] = field(default_factory=dict, compare=False, repr=False)
    """the motion at the instant that was last asked for: in a step it is asked for half a dozen times"""

    @property
    def still(self) -> bool:
        """Whether every held value is zero at all times."""
        return all(slot.still for slot in self.rows)

    def directions(self, nodes: Ints) -> tuple[Floats, NDArray[np.bool_]]:
        """What holds each of k different nodes: directions (k, dim, dim), zeros last, and which are contact's."""
        dim = self.points.shape[1]
        place = np.full(len(self.points), -1)
        place[nodes] = np.arange(len(nodes))
        held, contact = np.zeros((len(nodes), dim, dim)), np.zeros((len(nodes), dim), dtype=bool)
        filled = np.zeros(len(nodes), dtype=np.int64)
        for slot in self.rows:
            at = place[slot.support.nodes[slot.chosen]]
            new = (at >= 0) & (slot.length > 0)
            at = at[new]
            held[at, filled[at]] = slot.support.directions[slot.chosen[new]]
            contact[at, filled[at]] = slot.support.contact
            filled[at] += 1
        return held, contact

    def places(self, nodes: Ints) -> Callable[[int], str]:
        """Where the i-th of these nodes is, in words."""
        return lambda i: f"node {nodes[i]} at {tuple(float(x) for x in np.round(self.points[nodes[i]], 12))}"

    def gather(self, f: Forces) -> Forces:
        """P'f, forces on the free unknowns: a vector (n_u,), or a sparse matrix (n_u, q)."""
        return self.P.T @ f if self.columns is None else f[self.columns]

    def motion(self, t: float) -> Floats:
        """The held displacement u_D (n_u,) at the instant `t`, read-only.

        Raises
        ------
        SceneError
            Two prescriptions at one node contradict each other.
        """
        motion = self._last.get(t)
        if motion is None:
            at_nodes = np.zeros(self.points.shape)
            for slot in self.rows:
                slot.add(at_nodes, t)
            motion = at_nodes.ravel()
            motion.flags.writeable = False
            self._last.clear()
            self._last[t] = motion
        return motion


@dataclass(frozen=True)
class _Slot:
    """The k-th constraint of every node that has one: a triangular system node by node."""

    support: Support
    chosen: Ints
    """rows of `support` that fall into this slot"""
    unit: Floats
    """(m, dim) the orthonormal direction this row adds; zero where it is dependent on earlier ones"""
    length: Floats
    """(m,) what remains of the direction after projection"""

    @property
    def still(self) -> bool:
        return self.support.value is None

    def add(self, motion: Floats, t: float) -> None:
        nodes = self.support.nodes[self.chosen]
        if self.still and not motion[nodes].any():
            return
        wanted = np.zeros(len(nodes)) if self.support.value is None else self.support.value(t)[self.chosen]
        present = np.einsum("ij,ij->i", self.support.directions[self.chosen], motion[nodes])
        missing = wanted - present
        new = self.length > 0
        scale = max(np.abs(wanted).max(initial=0.0), np.abs(present).max(initial=0.0))
        wrong = ~new & (np.abs(missing) > PARALLEL * scale)
        if wrong.any() and not self.support.contact:
            row = int(np.argmax(wrong * np.abs(missing)))
            raise SceneError(
                f"{self.support.subject}: node {nodes[row]} at {self.support.points[self.chosen][row]} is to move by "
                f"{wanted[row]:.6g} along {self.support.directions[self.chosen][row]} at t = {t:.6g}, but other "
                f"supports already move it by {present[row]:.6g}. Prescribe each direction of a node once."
            )
        motion[nodes[new]] += (missing[new] / self.length[new])[:, None] * self.unit[new]


def resolve(supports: Sequence[Support], normals: Sequence[Friction | Obstacle], points: Floats) -> Supports:
    """Choose the frame of every node and split it into held and free directions.

    Parameters
    ----------
    supports, normals
        In canonical order; contact yields to prescribed displacements. Of the second, the normals become axes.
    points : (n_nodes, dim) array
    """
    dim = points.shape[1]
    frame = np.zeros((len(points), dim, dim))
    filled = np.zeros(len(points), dtype=np.int64)
    slots: list[_Slot] = []
    for support in sorted(supports, key=lambda s: s.contact):
        for chosen in _layers(support.nodes):
            unit, length = _append(frame, filled, support.nodes[chosen], support.directions[chosen])
            slots.append(_Slot(support, chosen, unit, length))
    held = filled.copy()
    for surface in normals:
        for chosen in _layers(surface.nodes):
            _append(frame, filled, surface.nodes[chosen], surface.normals[chosen])
    _fill_with_axes(frame, filled)
    return _free(frame, held, slots, points)


def _layers(nodes: Ints) -> list[Ints]:
    """Split rows so that no node occurs twice in a part; the order of rows is kept within a node."""
    order = np.argsort(nodes, kind="stable")
    ranked = nodes[order]
    start = np.concatenate([[True], ranked[1:] != ranked[:-1]]) if len(nodes) else np.zeros(0, dtype=bool)
    rank = np.arange(len(nodes)) - np.maximum.accumulate(np.where(start, np.arange(len(nodes)), 0))
    return [order[rank == k] for k in range(rank.max(initial=-1) + 1)]


def _append(frame: Floats, filled: Ints, nodes: Ints, directions: Floats) -> tuple[Floats, Floats]:
    """One Gram-Schmidt step at each of `nodes` (distinct); returns the new unit vectors and remainders."""
    rest = directions - np.einsum("nki,nkj,nj->ni", frame[nodes], frame[nodes], directions)
    length = np.linalg.norm(rest, axis=1)
    length[length <= PARALLEL] = 0.0
    new = length > 0
    unit = np.zeros_like(rest)
    unit[new] = rest[new] / length[new, None]
    frame[nodes[new], filled[nodes[new]]] = unit[new]
    filled[nodes[new]] += 1
    return unit, length


def _fill_with_axes(frame: Floats, filled: Ints) -> None:
    """Complete every frame by the axes least represented in it, so that axis-aligned frames stay exact."""
    dim = frame.shape[1]
    empty = filled == 0
    frame[empty] = np.eye(dim)
    filled[empty] = dim
    for _ in range(dim - 1):
        nodes = np.flatnonzero(filled < dim)
        if len(nodes) == 0:
            return
        least = np.argmin(np.einsum("nki,nki->ni", frame[nodes], frame[nodes]), axis=1)
        _append(frame, filled, nodes, np.eye(dim)[least])


def _free(frame: Floats, held: Ints, slots: list[_Slot], points: Floats) -> Supports:
    n_nodes, dim = points.shape
    node, k = np.nonzero(np.arange(dim)[None, :] >= held[:, None])
    directions = frame[node, k]
    along_axes = (np.abs(directions).max(axis=1) == 1.0) & (directions.sum(axis=1) == 1.0)
    columns = node * dim + np.argmax(directions, axis=1) if along_axes.all() else None
    rows = (node[:, None] * dim + np.arange(dim)).ravel()
    P = sp.coo_matrix(
        (directions.ravel(), (rows, np.repeat(np.arange(len(node)), dim))), shape=(n_nodes * dim, len(node))
    ).tocsr()
    P.eliminate_zeros()
    return Supports(P, node, columns, tuple(slots), points)
