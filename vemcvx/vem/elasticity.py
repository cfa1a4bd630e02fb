"""Elasticity on virtual elements: the stiffness matrix (3.13), strains and stresses of cells, motions without strain.

With Pi and |K| G_i = g_i as in :mod:`vemcvx.vem.projection`, Pi_0 div u the trace of eps(Pi u), on a cell K

    a_K^h(u, v) = 2 mu (eps(Pi u), eps(Pi v))_K + lam (Pi_0 div u, Pi_0 div v)_K
                  + tau h_K^(dim - 2) sum_i chi_i(u - Pi u) chi_i(v - Pi v),

which between the components a, b of the vertices i, j is

    (lam g_ia g_jb + mu g_ib g_ja + mu delta_ab g_i.g_j) / |K| + tau h_K^(dim - 2) delta_ab ((I - Pi)'(I - Pi))_ij.

tau = 2 mu ("shear") has the units of the rest and leaves the volumetric part alone, so nothing locks as lam grows;
tau = 1 ("unit") is (3.13) to the letter. On triangles and tetrahedra Pi v = v, and the last term is left out.

For any elastic matrix C (3, 3) a cell the first two terms are |K| eps(Pi u)' C eps(Pi v), eps = (e_xx, e_yy, 2 e_xy).
What Pi misses (hourglass modes) is mostly deviatoric, and tau stands for the modulus it meets. In Kelvin's notation,
C_k = D C D with D = diag(1, 1, sqrt 2), rotations of the plane act as rotations of R^3 that keep the volumetric
direction (1, 1, 0) and turn the deviatoric plane, spanned by (1, -1, 0) / sqrt 2 and (0, 0, 1), within itself. We take

    tau = smallest eigenvalue of C_k on the deviatoric plane = mean - sqrt(((p - q) / 2)^2 + r^2) of [[p, r], [r, q]].

In space, D = diag(1, 1, 1, sqrt 2, sqrt 2, sqrt 2), the deviatoric part has five dimensions. tau has the units of C,
does not depend on the axes, and is 2 mu for an isotropic material. It does not lock: a
volumetric modulus that grows leaves the deviatoric plane alone, and fibres whose modulus grows add a matrix of rank
one to it, which leaves the smallest of its eigenvalues bounded. (The trace or the mean would grow with the fibres:
with E1 / G = 2e8 and 8 Voronoi cells a side, 1.04 of the energy of a sheared body is found; with either of them
nothing.)

Components of symmetric tensors are in the order xx, yy, xy in the plane and xx, yy, zz, xy, yz, xz in space; of
strains those across are 2 e_xy and so on. Moduli are rows over cells: (2, n_cells) Lame's lam (in the plane as it acts
there) and mu, or the upper triangle of the elastic matrix C row by row: in the plane (6, n_cells), xx-xx, xx-yy, xx-xy,
yy-yy, yy-xy, xy-xy, and in space (21, n_cells). Principal stresses in the plane, and von Mises' equivalent stress:

    sigma_1,2 = (xx + yy) / 2 +- sqrt(((xx - yy) / 2)^2 + xy^2)                                 Mohr's circle (1882)
    sigma_v^2 = ((xx - yy)^2 + (yy - zz)^2 + (zz - xx)^2) / 2 + 3 (xy^2 + yz^2 + xz^2)          von Mises (1913)

zz, across the plane, is the third principal stress: 0 in plane stress, lam (e_xx + e_yy) and more in plane strain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from math import isqrt

import numpy as np
import scipy.sparse as sp
from scipy.linalg.lapack import dpstrf

from vemcvx.base.arrays import SOME, Bools, Floats, Ints
from vemcvx.vem.projection import CHUNK, CellGroup
from vemcvx.vem.space import Space
from vemcvx.vem.stabilisation import (
    Stabilisation,
    VertexWeights,
    add_stabilisation,
    missed_energies,
    missed_products,
    stabilisation_of,
)


@dataclass(frozen=True, eq=False)
class SumOverCells:
    """A matrix (n_u, n_u) over all nodal values, the sum of local ones: nothing of it stands before it is asked for.

    Cells that are translates of each other, to the bit, and have the same moduli share one local matrix; mirror images
    have one of their own, which is one more in a piece of thousands.
    """

    space: Space
    local: Callable[..., Floats]  #: of a piece of a group of cells and its moduli, (c, n, n, dim, dim)
    filled: Bools  #: (n_cells,); of the others there are no local matrices, where any is filled
    moduli: Sequence[Floats]  #: arrays (n_cells, ...)

    @cached_property
    def _groups(self) -> Sequence[CellGroup]:
        if self.filled.all() or not self.filled.any():
            return self.space.groups
        return [group.part(np.flatnonzero(self.filled[group.cells])) for group in self.space.groups]

    def whole(self) -> sp.csr_matrix:
        """All of it; column indices are sorted, without duplicates."""
        groups = self._groups
        return assemble([group.nodes for group in groups], *self._blocks(groups), self.space.mesh.n_nodes)

    def _blocks(self, groups: Sequence[CellGroup]) -> tuple[Floats, Ints]:
        """Blocks (k, dim^2) that couple two vertices of a cell, and which of them each pair of vertices has."""
        dim, found, which, first = self.space.dim, list[Floats](), list[Ints](), 0
        for group in groups:
            for chunk in group.chunks(CHUNK):
                pairs = chunk.nodes.shape[1] ** 2
                own = [each[chunk.cells] for each in self.moduli]
                some, same = distinct([*chunk.shapes, *own])
                found.append(self.local(chunk.part(some), *(each[some] for each in own)).reshape(-1, dim * dim))
                begin = first + pairs * same.astype(np.int32)
                which.append((begin[:, None] + np.arange(pairs, dtype=np.int32)).ravel())
                first += len(found[-1])
        return np.concatenate(found), np.concatenate(which)


def distinct(arrays: Sequence[Floats]) -> tuple[Ints | slice, Ints]:
    """Places of one each of the rows of arrays (c, ...) that differ, and (c,) which of them a row is.

    All are taken for different where many are.
    """
    every = np.arange(len(arrays[0]))
    if all((each == each[:1]).all() for each in arrays):
        return slice(1), np.zeros_like(every)
    rows = np.hstack([each.reshape(len(each), -1) for each in arrays])
    # 64 cells show whether many are translates of others: to find which costs a fifth of a local matrix.
    if len(np.unique(rows[:64], axis=0)) > 32:
        return slice(None), every
    # Of their bits, modulo 2^64: sums of numbers would be equal where these differ by rounding.
    weights = np.random.default_rng(0).integers(2**64, size=rows.shape[1], dtype=np.uint64) | np.uint64(1)
    hashes = (rows.view(np.uint64) * weights).sum(axis=1)
    _, some, same = np.unique(hashes, return_index=True, return_inverse=True)
    return (some, same) if (rows == rows[some[same]]).all() else (slice(None), every)


def assemble(nodes: Sequence[Ints], blocks: Floats, which: Ints, n_nodes: int) -> sp.csr_matrix:
    """Add up blocks that couple the vertices of cells; column indices are sorted, without duplicates.

    `nodes` are the vertices (c, n) of the cells, one array a number of vertices; `which` (pairs,) of the `blocks` (k,
    dim^2) are added: arrays of `nodes` in turn, cell by cell, vertex i by vertex j.
    """
    which, bounds, columns, indptr = _gathered(nodes, which, n_nodes)
    dim = isqrt(blocks.shape[1])

    def of_nodes(start: int, stop: int) -> sp.csr_matrix:
        i, j = indptr[[start, stop]]
        p, q = bounds[[i, j]]
        gather = sp.csr_matrix((np.ones(q - p), which[p:q], bounds[i : j + 1] - p), shape=(j - i, len(blocks)))
        entries = (gather @ blocks).reshape(-1, dim, dim), columns[i:j], indptr[start : stop + 1] - i
        return sp.bsr_matrix(entries, shape=(dim * (stop - start), dim * n_nodes)).tocsr()

    starts = range(0, max(n_nodes, 1), SOME)
    return sp.vstack([of_nodes(start, min(start + SOME, n_nodes)) for start in starts], format="csr")


def _gathered(nodes: Sequence[Ints], which: Ints, n_nodes: int) -> tuple[Ints, Ints, Ints, Ints]:
    """Blocks in the order of the rows and columns of their sums, k of them.

    Returns which blocks (pairs,), where those of each sum begin (k + 1,), its column (k,), and where the sums of each
    row begin (n_nodes + 1,). What orders them is gone when the matrix is made: of cubes it takes .34 GB a million.
    """
    small = [group.astype(np.int32) for group in nodes]  # half the memory traffic; enough for 2e9 nodes
    rows = np.concatenate([np.repeat(group, group.shape[1]) for group in small])
    columns = np.concatenate([np.tile(group, group.shape[1]).ravel() for group in small])
    counts = sum(group.shape[1] * np.bincount(group.ravel(), minlength=n_nodes) for group in small)
    order = _counting_sort(columns, n_nodes)
    order = order[_counting_sort(rows[order], n_nodes)]
    columns, begins = columns[order], np.ones(len(order), dtype=bool)
    np.not_equal(columns[1:], columns[:-1], out=begins[1:])
    indptr = np.append(0, np.cumsum(counts))
    begins[indptr[:-1][np.diff(indptr) > 0]] = True
    first = np.flatnonzero(begins)
    return which[order], np.append(first, len(order)), columns[first], np.searchsorted(first, indptr)


def _counting_sort(keys: Ints, n: int) -> Ints:
    """Stable argsort of integers below n in linear time: the rows of a column-wise copy of a one-entry-a-row matrix."""
    m = len(keys)
    columns = sp.csr_matrix((np.empty(m, dtype=np.int8), keys, np.arange(m + 1)), shape=(m, n)).tocsc()
    return np.asarray(columns.indices)


def add_weights(blocks: Floats, cells: CellGroup, tau: Floats) -> None:
    """Add tau h_K^(dim - 2) (I - Pi)'(I - Pi), component by component, to local matrices (c, n, n, dim, dim)."""
    if cells.simplices:
        return
    stable = (tau * cells.stabilised_size)[:, None, None] * missed_products(cells.vertex_values())
    for axis in range(blocks.shape[-1]):
        blocks[..., axis, axis] += stable


def stiffness(space: Space, lam: Floats, mu: Floats, stabilisation: str | Stabilisation = "shear") -> sp.csr_matrix:
    """Matrix of a^h over all nodal values, (n_u, n_u), symmetric to the bit.

    Parameters
    ----------
    space : Space
    lam, mu : (n_cells,) arrays
        Lame's constants, force per area; `lam` already reduced in plane stress. Both zero on cells that another
        material fills.
    stabilisation : {"shear", "unit"}, or Stabilisation
        tau = 2 mu, or tau = 1, or one's own.

    Raises
    ------
    SceneError
        `stabilisation` is neither, or its form is none.

    Notes
    -----
    Scaling all coordinates by a power of two changes no bit; scaling moduli by one scales the matrix exactly
    (with "unit", its consistent part). Entries that happen to vanish are stored.
    """
    return stiffness_of(space, np.stack([lam, mu]), stabilisation_of(stabilisation, mu)).whole()


def stiffness_of(space: Space, moduli: Floats, stabilisation: Stabilisation) -> SumOverCells:
    """The same of moduli in either form, which are zero on cells that another material fills."""
    weights = (stabilisation.tau,) if isinstance(stabilisation, VertexWeights) else ()
    filled = (moduli != 0.0).any(axis=0)
    if len(moduli) == 2 and weights:
        return SumOverCells(space, local_blocks, filled, (*moduli, *weights))

    def local(cells: CellGroup, moduli: Floats, *tau: Floats) -> Floats:
        C = elastic_matrix(moduli.T, space.dim)
        blocks = consistent_blocks(cells, C)
        if tau:
            add_weights(blocks, cells, *tau)
        else:
            add_stabilisation(blocks, cells, stabilisation, C)
        return blocks

    return SumOverCells(space, local, filled, (moduli.T, *weights))


def local_blocks(cells: CellGroup, lam: Floats, mu: Floats, tau: Floats) -> Floats:
    """The local matrices (c, n, n, dim, dim) of cells with n vertices.

    Entry (K, i, j, a, b) couples component a of vertex i with component b of vertex j.
    """
    measures, g = cells.gradients()
    lam, mu = (lam / measures)[:, None, None], (mu / measures)[:, None, None]
    axes = range(g.shape[2])
    square = [g[:, :, None, a] * g[:, None, :, a] for a in axes]
    blocks = np.empty((*square[0].shape, len(axes), len(axes)))
    for a in axes:
        others = reduce(np.add, [square[b] for b in axes if b != a])
        blocks[..., a, a] = (lam + 2.0 * mu) * square[a] + mu * others
        for b in range(a + 1, len(axes)):
            ab = g[:, :, None, a] * g[:, None, :, b]
            ba = ab.transpose(0, 2, 1)
            blocks[..., a, b] = lam * ab + mu * ba
            blocks[..., b, a] = lam * ba + mu * ab
    add_weights(blocks, cells, tau)
    return blocks


def softest_shear(C: Floats) -> Floats:
    """The smallest Kelvin modulus of deviatoric strains, (n_cells,); 2 mu where C is isotropic."""
    return np.maximum(_deviatoric_moduli(C)[:, 0], 0.0)


def mean_shear(C: Floats) -> Floats:
    """The harmonic mean (n_cells,) of the Kelvin moduli of deviatoric strains; 2 mu where C is isotropic."""
    moduli = _deviatoric_moduli(C)
    positive = moduli[:, 0] > 0
    inverses = 1.0 / np.where(positive[:, None], moduli, 1.0)
    return np.where(positive, 1.0 / inverses.mean(axis=1), 0.0)


def _deviatoric_moduli(C: Floats) -> Floats:
    """The Kelvin moduli of deviatoric strains, ascending: (n_cells, 2), in space (n_cells, 5)."""
    basis, across = np.zeros((2, 3)), 1
    basis[0, :2] = np.array([1.0, -1.0]) / np.sqrt(2.0)
    if C.shape[1] == len(COMPONENTS[3]):
        basis, across = np.zeros((5, 6)), 3
        basis[0, :2], basis[1, :3] = np.array([1.0, -1.0]) / np.sqrt(2.0), np.array([1.0, 1.0, -2.0]) / np.sqrt(6.0)
    basis[-across:, -across:] = np.sqrt(2.0) * np.eye(across)
    return np.asarray(np.linalg.eigvalsh(basis @ C @ basis.T))


def consistent_blocks(cells: CellGroup, C: Floats) -> Floats:
    """|K| eps(Pi u)' C eps(Pi v), the consistent part of a_K^h, as local matrices (c, n, n, dim, dim)."""
    measures, g = cells.gradients()
    count, n, dim = g.shape
    B = _strain_rows(g)
    blocks: Floats = np.matmul(B.transpose(0, 2, 1), np.matmul(C / measures[:, None, None], B))
    blocks = 0.5 * (blocks + blocks.transpose(0, 2, 1))
    return blocks.reshape(count, n, dim, n, dim).transpose(0, 1, 3, 2, 4)


def _strain_rows(g: Floats) -> Floats:
    """|K| eps(Pi u) of a unit displacement of each vertex along each axis: (c, components, n dim)."""
    count, n, dim = g.shape
    B = np.zeros((count, len(COMPONENTS[dim]), n, dim))
    for k, (a, b) in enumerate(COMPONENTS[dim]):
        B[:, k, :, a], B[:, k, :, b] = g[:, :, b], g[:, :, a]
    return B.reshape(count, -1, n * dim)


def energy_rows(space: Space, C: Floats, stabilisation: Stabilisation) -> sp.csr_matrix:
    """F (k, n_u) with F'F the matrix of a^h over all nodal values; a row of F reads the vertices of one cell alone.

    Of a cell these are the roots of its two parts: |K|^{1/2} R eps(Pi u), R'R = C, and a Cholesky factor of the
    stabilisation, as many rows as that has rank. F is no factor of the whole matrix, so nothing fills it.

    Parameters
    ----------
    space : Space
    C : (n_cells, 3, 3) array, in space (n_cells, 6, 6)
        Zero on cells without a material.
    stabilisation : Stabilisation
    """
    dim, rows = space.dim, 0
    data, i, j = list[Floats](), list[Ints](), list[Ints]()
    filled = C[:, 0, 0] > 0.0
    for group in space.groups:
        for chunk in group.part(np.flatnonzero(filled[group.cells])).chunks(CHUNK):
            roots = _local_roots(chunk, C[chunk.cells], stabilisation)
            columns = (dim * chunk.nodes[:, :, None] + np.arange(dim)).reshape(len(roots), 1, -1)
            own = rows + np.arange(roots.shape[0] * roots.shape[1]).reshape(*roots.shape[:2], 1)
            there = np.nonzero(roots)
            data.append(roots[there])
            i.append(np.broadcast_to(own, roots.shape)[there])
            j.append(np.broadcast_to(columns, roots.shape)[there])
            rows += own.size
    entries = np.concatenate(data), (np.concatenate(i), np.concatenate(j))
    return sp.csr_matrix(entries, shape=(rows, dim * space.mesh.n_nodes))


def _local_roots(cells: CellGroup, C: Floats, stabilisation: Stabilisation) -> Floats:
    """(c, r, n dim) rows whose squares add up to a_K^h(v, v) of cells with n vertices."""
    measures, g = cells.gradients()
    count, n, dim = g.shape
    upper = np.linalg.cholesky(C / measures[:, None, None]).transpose(0, 2, 1)
    consistent: Floats = np.matmul(upper, _strain_rows(g))
    if cells.simplices:
        return consistent
    stable = np.zeros((count, n, n, dim, dim))
    add_stabilisation(stable, cells, stabilisation, C)
    size = n * dim
    rank = size - dim * (dim + 1)  # linear displacements have no such energy
    roots = np.zeros((count, rank, size))
    for root, local in zip(roots, stable.transpose(0, 1, 3, 2, 4).reshape(count, size, size), strict=True):
        factor, order, _, _ = dpstrf(local)
        root[:, order - 1] = np.triu(factor)[:rank]
    return np.concatenate([consistent, roots], axis=1)


def cell_energies(space: Space, moduli: Floats, stabilisation: Stabilisation, u: Floats) -> Floats:
    """a_K^h(u, u) of nodal displacements u (n_nodes, dim), cell by cell: (n_cells,), force times length."""
    strain = strains(space, u)
    density = np.sum(strain * stresses(moduli, strain), axis=1)
    missed = missed_energies(space, stabilisation, elastic_matrix(moduli, space.dim), u)
    return np.asarray(space.mesh.measures * density + missed)


def strains(space: Space, u: Floats, groups: Sequence[CellGroup] | None = None) -> Floats:
    """The mean strain of a virtual function on each cell, eps(Pi u), (3.13): (n_cells, components).

    These are e_xx, e_yy and 2 e_xy in the plane, and e_xx, e_yy, e_zz, 2 e_xy, 2 e_yz, 2 e_xz in space. u are nodal
    displacements, (n_nodes, dim) or (n_u,). Where `groups` of some cells are given, rows of others mean nothing.
    """
    dim = space.mesh.points.shape[1]
    u = np.reshape(u, (-1, dim))
    result = np.empty((space.mesh.n_cells, len(COMPONENTS[dim])))
    for group in space.groups if groups is None else groups:
        for chunk in group.chunks(CHUNK):
            measures, g = chunk.gradients()
            v = u.take(chunk.nodes, axis=0)
            # Differences from a vertex: a rigid translation much larger than the deformation costs no digits.
            v -= v[:, :1].copy()
            for k, (a, b) in enumerate(COMPONENTS[dim]):
                sums = np.einsum("ci,ci->c", v[:, :, a], g[:, :, b])
                if a != b:
                    sums += np.einsum("ci,ci->c", v[:, :, b], g[:, :, a])
                result[chunk.cells, k] = sums / measures
    return result


def rigid_modes(points: Floats) -> Floats:
    """The infinitesimal rigid motions (n_u, 3 or 6): translations along the axes, then rotations about the origin.

    In the plane the rotation is (-y, x), in space they are (0, -z, y), (z, 0, -x) and (-y, x, 0).
    """
    dim = points.shape[1]
    turns = ((0, 1),) if dim == 2 else ((1, 2), (2, 0), (0, 1))
    modes = np.zeros((*points.shape, dim + len(turns)))
    for axis in range(dim):
        modes[:, axis, axis] = 1.0
    for k, (a, b) in enumerate(turns, start=dim):
        modes[:, a, k] = -points[:, b]
        modes[:, b, k] = points[:, a]
    return modes.reshape(-1, modes.shape[2])


def split_motion(mode: Floats) -> tuple[Floats, Floats]:
    """The translation and the rotation, one number in the plane and three in space, of a sum of rigid modes."""
    return (mode[:2], mode[2:]) if len(mode) == 3 else (mode[:3], mode[3:])


COMPONENTS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))}
"""Of symmetric tensors in dim dimensions, axis by axis."""


def component_names(dim: int) -> tuple[str, ...]:
    """The names of components: xx, yy, xy ..."""
    return tuple("xyz"[a] + "xyz"[b] for a, b in COMPONENTS[dim])


def isotropic_stress(value: Floats, dim: int) -> Floats:
    """(k, components) of a stress (k,) in all directions."""
    return np.column_stack([value if a == b else np.zeros_like(value) for a, b in COMPONENTS[dim]])


def stresses(moduli: Floats, strain: Floats) -> Floats:
    """Stresses (n_cells, components) of strains of these components."""
    if len(moduli) != 2:
        return np.einsum("ckl,cl->ck", elastic_matrix(moduli), strain)
    lam, mu = moduli
    dim = 2 if strain.shape[1] == len(COMPONENTS[2]) else 3
    trace = strain[:, 0] + strain[:, 1] if dim == 2 else strain[:, 0] + strain[:, 1] + strain[:, 2]
    normal = [2 * mu * strain[:, a] + lam * trace for a in range(dim)]
    return np.column_stack([*normal, *(mu * shear for shear in strain[:, dim:].T)])


def tractions(sigma: Floats, normals: Floats) -> Floats:
    """sigma n (k, dim) of stresses (k, components) and normals (k, dim), of any length."""
    force = np.zeros(normals.shape)
    for component, (a, b) in zip(sigma.T, COMPONENTS[normals.shape[1]], strict=True):
        force[:, a] += component * normals[:, b]
        if a != b:
            force[:, b] += component * normals[:, a]
    return force


def elastic_matrix(moduli: Floats, dim: int = 2) -> Floats:
    """C (n_cells, 3, 3), in space (n_cells, 6, 6), of moduli in either form; `dim` counts for Lame's alone."""
    if len(moduli) != 2:
        size = len(COMPONENTS[2 if len(moduli) == 6 else 3])
        upper, C = np.triu_indices(size), np.zeros((moduli.shape[1], size, size))
        C[:, upper[0], upper[1]] = C[:, upper[1], upper[0]] = moduli.T
        return C
    (lam, mu), size = moduli, len(COMPONENTS[dim])
    C = np.zeros((len(lam), size, size))
    C[:, :dim, :dim] = lam[:, None, None]
    for a in range(size):
        C[:, a, a] += 2 * mu if a < dim else mu
    return C


def upper_triangle(C: Floats) -> Floats:
    """Moduli (6, n_cells), in space (21, n_cells), of elastic matrices."""
    rows, columns = np.triu_indices(C.shape[1])
    return np.ascontiguousarray(C[:, rows, columns].T)


def principal(stress: Floats) -> Floats:
    """Principal stresses (n, dim), those in the plane or all three, the largest first, of stresses (n, components)."""
    dim = 3 if stress.shape[1] == len(COMPONENTS[3]) else 2
    tensor = np.empty((len(stress), dim, dim))
    for (a, b), component in zip(COMPONENTS[dim], stress.T, strict=True):
        tensor[:, a, b] = tensor[:, b, a] = component
    return np.ascontiguousarray(np.linalg.eigvalsh(tensor)[:, ::-1])


def equivalent(stress: Floats, out_of_plane: Floats | None = None) -> Floats:
    """Von Mises' stress (n,) of stresses (n, 6), or (n, 3) in the plane and (n,), zz, across it."""
    if out_of_plane is None:
        xx, yy, zz, *shear = stress.T
    else:
        xx, yy, *shear = stress.T
        zz = out_of_plane
    apart = (xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2
    squared: Floats = 0.5 * apart + 3.0 * sum(component**2 for component in shear)
    return np.sqrt(squared)
