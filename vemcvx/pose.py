"""From a scene on a mesh to a System: the contributions summed, the supports eliminated.

With u = P y + u_D(t) (:mod:`vemcvx.supports`), A the stiffness over all nodal values and B^ the tangential
projections at the contact nodes,

    K = P'A P,   load = P'(f - A u_D),   B = B^ P,   drag = B^ u_D,   stretch = P'A u_D.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.effects import ContactSurface, Friction, Load, Material
from vemcvx.errors import SceneWarning
from vemcvx.meshes import PolygonMesh
from vemcvx.ordering import nested_dissection
from vemcvx.rigid import refuse_floating
from vemcvx.scene import Scene
from vemcvx.supports import PARALLEL, Supports, resolve
from vemcvx.system import Motion, Norms, System
from vemcvx.vem import Space, rigid_modes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Terms:
    """The norm terms of a posed scene, over all nodal values."""

    rows: sp.csr_matrix
    """(m * (dim - 1), n_u) B^, orthonormal tangents"""
    nodes: Ints
    lengths: Floats
    """(m,) integrals of the nodal basis functions over the edges with friction"""
    weights: Callable[[float], Floats]


@dataclass(frozen=True)
class Posed:
    """A scene on a mesh, ready to march."""

    scene: Scene
    space: Space
    system: System
    supports: Supports
    A: sp.csr_matrix
    """(n_u, n_u) stiffness over all nodal values"""
    loads: tuple[Load, ...]
    terms: Terms
    surfaces: tuple[ContactSurface, ...]
    material: Material

    @property
    def contact(self) -> tuple[Ints, Floats, Floats]:
        """Contact nodes not held otherwise, their normals and lengths: see :func:`contact_surface`."""
        return contact_surface(self.surfaces, self.supports, self.space.mesh.points)

    def force(self, t: float) -> Floats:
        """The nodal load f (n_u,) of everything but reactions."""
        return total_load(self.loads, self.A.shape[0], t)

    def displacement(self, y: Floats, t: float) -> Floats:
        """u (n_u,) from the free unknowns y (n,)."""
        u = self.supports.P @ y
        return u if self.supports.still else u + self.supports.motion(t)


def pose(scene: Scene, mesh: PolygonMesh) -> Posed:
    """Assemble a scene on a mesh.

    Raises
    ------
    SceneError
        The scene names what the mesh lacks, or leaves the body free to float.
    """
    space = Space(mesh)
    parts = [effect.contribute(space) for effect in scene.canonical]
    A = _sum([p.stiffness for p in parts if p.stiffness is not None])
    loads = _chain(p.loads for p in parts)
    frictions: tuple[Friction, ...] = _chain(p.frictions for p in parts)
    supports = resolve(_chain(p.supports for p in parts), frictions, mesh.points)
    refuse_floating(space, supports)
    terms = _friction(frictions, supports, mesh.points)
    system = System(
        _restrict(A, supports),
        _load(loads, A, supports),
        _norms(terms, supports, mesh.points),
        None if supports.still else _motion(A, supports, terms.rows),
        _order(A, supports, mesh.points),
        supports.P.T @ rigid_modes(mesh.points),
    )
    material = next(p.material for p in parts if p.material is not None)
    return Posed(scene, space, system, supports, A, loads, terms, _chain(p.surfaces for p in parts), material)


def total_load(loads: Sequence[Load], n: int, t: float) -> Floats:
    """The sum of nodal loads (n,) at `t`."""
    f = np.zeros(n)
    for load in loads:
        f += load.vector(t)
    return f


def _chain(tuples: object) -> tuple:
    return tuple(item for part in tuples for item in part)  # type: ignore[attr-defined]


def _sum(matrices: Sequence[sp.csr_matrix]) -> sp.csr_matrix:
    total = matrices[0]
    for matrix in matrices[1:]:
        total = total + matrix
    return total


def _restrict(A: sp.csr_matrix, supports: Supports) -> sp.csr_matrix:
    if supports.columns is not None:
        return A[supports.columns][:, supports.columns]
    K = supports.P.T @ A @ supports.P
    # The triple product rounds (i, j) and (j, i) differently.
    return sp.csr_matrix(0.5 * (K + K.T))


def _load(loads: tuple[Load, ...], A: sp.csr_matrix, supports: Supports) -> Callable[[float], Floats]:
    def load(t: float) -> Floats:
        f = total_load(loads, A.shape[0], t)
        if not supports.still:
            f -= A @ supports.motion(t)
        return supports.gather(f)

    return load


def _motion(A: sp.csr_matrix, supports: Supports, tangential: sp.csr_matrix) -> Motion:
    def stretch(t: float) -> Floats:
        return supports.gather(A @ supports.motion(t))

    def drag(t: float) -> Floats:
        return tangential @ supports.motion(t)

    def stored(s: float, t: float) -> float:
        return float(supports.motion(s) @ (A @ supports.motion(t)))

    return Motion(stretch, drag, stored)


def _friction(frictions: Sequence[Friction], supports: Supports, points: Floats) -> Terms:
    """The terms of all frictions where something can slip; equal node and normal make one term."""
    dim = points.shape[1]
    if not frictions:
        none = np.zeros(0)
        return Terms(sp.csr_matrix((0, points.size)), none.astype(np.int64), none, lambda t: none)
    nodes = np.concatenate([f.nodes for f in frictions])
    normals = np.concatenate([f.normals for f in frictions])
    first, term = _merge(nodes, normals)
    rows = _tangential_rows(nodes[first], normals[first], points)
    slides = np.diff(_on_free(rows, supports).indptr).reshape(len(first), dim - 1).any(axis=1)
    gather = sp.csr_matrix((np.ones(len(term)), (term, np.arange(len(term)))), shape=(len(first), len(term)))
    gather = gather[np.flatnonzero(slides)]
    lengths = np.zeros(len(first))
    np.maximum.at(lengths, term, np.concatenate([f.lengths for f in frictions]))

    def weights(t: float) -> Floats:
        return gather @ np.concatenate([f.weights(t) for f in frictions])

    _warn_of_loose_normals(frictions, supports, points)
    kept = np.flatnonzero(np.repeat(slides, dim - 1))
    return Terms(sp.csr_matrix(rows[kept]), nodes[first][slides], lengths[slides], weights)


def _warn_of_loose_normals(frictions: Sequence[Friction], supports: Supports, points: Floats) -> None:
    """Friction where nothing holds the normal is a body rubbing on air: almost always a forgotten contact."""
    dim = points.shape[1]
    for friction in frictions:
        k = len(friction.nodes)
        columns = (friction.nodes[:, None] * dim + np.arange(dim)).ravel()
        normal = sp.csr_matrix(
            (friction.normals.ravel(), columns, np.arange(0, k * dim + 1, dim)), shape=(k, points.size)
        )
        free = abs(sp.csr_matrix(normal @ supports.P)).max(axis=1).toarray().ravel() > PARALLEL
        if free.any():
            warnings.warn(
                f"{friction.subject}: at {free.sum()} of {k} places nothing holds the body in the normal direction; "
                "add BilateralContact on the same boundary, unless it is meant to slide on air.",
                SceneWarning,
                stacklevel=2,
            )


def _on_free(rows: sp.csr_matrix, supports: Supports) -> sp.csr_matrix:
    """B = B^ P without the rounding of t . n = 0 and t . t = 1."""
    B = sp.csr_matrix(rows @ supports.P)
    B.data[np.abs(B.data) < PARALLEL] = 0.0
    unit = np.abs(np.abs(B.data) - 1.0) < PARALLEL
    B.data[unit] = np.sign(B.data[unit])
    B.eliminate_zeros()
    return B


def _merge(nodes: Ints, normals: Floats) -> tuple[Ints, Ints]:
    """Rows of one node with one normal (up to sign) are one term: its first row, and the term of every row."""
    term = np.full(len(nodes), -1)
    first: list[Ints] = []
    while (term < 0).any():
        left = np.flatnonzero(term < 0)
        lead = left[np.unique(nodes[left], return_index=True)[1]]
        leader = np.full(nodes.max() + 1, -1)
        leader[nodes[lead]] = np.arange(len(lead))
        mine = leader[nodes[left]]
        reference = normals[lead[mine]]
        along = np.einsum("ij,ij->i", normals[left], reference)
        apart = np.linalg.norm(normals[left] - along[:, None] * reference, axis=1)
        same = apart < PARALLEL
        term[left[same]] = mine[same] + sum(map(len, first))
        first.append(lead)
    return np.concatenate(first), term


def _tangential_rows(nodes: Ints, normals: Floats, points: Floats) -> sp.csr_matrix:
    """(m * (dim - 1), n_u) orthonormal tangents of each row."""
    m, dim = normals.shape
    # The right singular vectors beyond the first span the plane across the normal.
    tangents = _across(normals)
    columns = np.repeat(nodes[:, None] * dim + np.arange(dim), dim - 1, axis=0)
    indptr = np.arange(0, m * (dim - 1) * dim + 1, dim)
    return sp.csr_matrix((tangents.reshape(-1), columns.ravel(), indptr), shape=(m * (dim - 1), points.size))


def _across(normals: Floats) -> Floats:
    """(m, dim - 1, dim) orthonormal vectors across each normal; exact where the normal is an axis."""
    dim = normals.shape[1]
    if dim == 2:
        return np.stack([-normals[:, 1], normals[:, 0]], axis=1)[:, None, :]
    return np.linalg.svd(normals[:, None, :])[2][:, 1:, :]


def _norms(terms: Terms, supports: Supports, points: Floats) -> Norms | None:
    nodes = terms.nodes
    if len(nodes) == 0:
        return None

    def place(i: int) -> str:
        return f"node {nodes[i]} at {tuple(float(x) for x in np.round(points[nodes[i]], 12))}"

    return Norms(_on_free(terms.rows, supports), terms.weights, terms.rows.shape[0] // len(nodes), place)


def _order(A: sp.csr_matrix, supports: Supports, points: Floats) -> Ints:
    """Nested dissection of the nodes, all unknowns of a node together."""
    dim = points.shape[1]
    n = len(points)
    graph = sp.csr_matrix(
        (np.ones(len(A.indices[::1]), dtype=np.int8), A.indices // dim, A.indptr), shape=(A.shape[0], n)
    )[::dim]
    rank = np.empty(n, dtype=np.int64)
    rank[nested_dissection(graph, points)] = np.arange(n)
    return np.argsort(rank[supports.nodes], kind="stable")


def contact_surface(
    surfaces: Sequence[ContactSurface], supports: Supports, points: Floats
) -> tuple[Ints, Floats, Floats]:
    """Contact nodes that are not held otherwise (m,), their outward normals (m, dim) and int phi_i (m,)."""
    dim = points.shape[1]
    if not surfaces:
        return np.zeros(0, dtype=np.int64), np.zeros((0, dim)), np.zeros(0)
    nodes = np.concatenate([s.nodes for s in surfaces])
    normals = np.concatenate([s.normals for s in surfaces])
    first, term = _merge(nodes, normals)
    # Effects on one boundary bring the same edges: their lengths are one length, not a sum.
    lengths = np.zeros(len(first))
    np.maximum.at(lengths, term, np.concatenate([s.lengths for s in surfaces]))
    rows = _tangential_rows(nodes[first], normals[first], points)
    slides = np.diff(_on_free(rows, supports).indptr).reshape(len(first), dim - 1).any(axis=1)
    free, place = np.unique(nodes[first][slides], return_inverse=True)
    normal, length = np.zeros((len(free), dim)), np.zeros(len(free))
    np.add.at(normal, place, (lengths[:, None] * normals[first])[slides])
    np.add.at(length, place, lengths[slides])
    return free, normal / np.linalg.norm(normal, axis=1)[:, None], length
