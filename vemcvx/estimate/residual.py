"""The residual estimate eta_K of the mesh error in each cell K.

    eta_K^2 = c^2 (  h_K^2 / (9 mu) |f|^2_K                                                body force
                   + sum over inner sides     d_e / (4 mu) |[(sigma + q) n]|^2_e / 2       jumps, halved between cells
                   + sum over boundary sides  d_e / (2 mu) |t - (sigma + q) n|^2_e )       loads, contact, springs
              + int_K q I : C^{-1} q I
              + the larger of
                     s S_K(u - Pi u, u - Pi u)                                              the stabilisation
                     sum over edges  |K| / l_e  E / (3 2^(dim - 1)) |eps_ss(u) - eps_ss(Pi u)|^2_e
              + d_e / (2 mu) |t - t_e|^2_e + h_K^2 / (9 mu) |f - f_K|^2_K                  errors of assembled data
              + int_K s_0 : C^{-1} s_0,  s_0 = (C - C_K) eps(Pi u) + sigma_0 - sigma_0K

- u is the computed displacement, Pi u its linear projection in each cell, and S_K the stabilisation.
- sigma = C eps(Pi u) + sigma_0 is the stress, with the elastic tensor C and the prestress sigma_0. mu is the shear
  modulus, E Young's modulus along an edge, and eps_ss the strain along an edge.
- f is the body force, and t the traction of loads, contact and springs.
- A side e is an edge or, in space, a face. [.] is the jump across a side with the normal n, and |.|_e an L2
  norm. Residuals on boundary sides have only the components that the supports leave free.
- c is CONSTANT or, in space, IN_SPACE (docs/theory/error_estimates.md).
- h_K is the longest side of a box with the second moments of K. l_e is the width of K along an edge.
- In the plane, s = 1 and q = 0. In space, s = 7 |K|^{1/3} / (D_K N_K) with the diameter D_K and the number N_K of
  vertices. The pressure q in space is constant in each cell, and minimises the sum of all terms with q.
- t_e is the mean of t over a side. f_K, C_K and sigma_0K are values at the centroid of K. In the plane, friction
  bounds and gaps that are not linear between nodes also add terms (`Reader.local_errors`).
- d_e is the mean width *across* e of the cells that meet at e.

The terms follow Verfurth, *A Posteriori Error Estimation Techniques for Finite Element Methods* (2013), and Cangiani,
Georgoulis, Pryer and Sutton (Numer. Math. 137, 2017).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import SAME, Floats, Ints, totals
from vemcvx.bound.reading import POINCARE, Reader, compare_stresses, list_parts, varies_in_place
from vemcvx.bound.skeleton import Instant, Joints, body_forces, extents, skeleton
from vemcvx.effects import Contribution, Load
from vemcvx.meshes import PolyhedralMesh
from vemcvx.meshes.interfaces import faces_of
from vemcvx.meshes.polygons import cell_of_corner, next_corner, positions, right_of, rows_in_order, spans
from vemcvx.meshes.polyhedra import list_faces
from vemcvx.scene import ContactRows, PosedScene, jump_rows
from vemcvx.vem import strains
from vemcvx.vem.elasticity import mean_shear
from vemcvx.vem.projection import face_groups
from vemcvx.vem.tensors import elastic_matrix, stresses, tractions

CONSTANT, IN_SPACE = 0.63, 0.8
"""The constants c in the plane and in space."""
SPATIAL_FACTOR = 7.0  # the factor in s


@dataclass(frozen=True, kw_only=True)
class MeshSides:
    """The geometry of n_cells cells, n_inner inner sides and n_outer outer sides."""

    inner: Ints  # cells of inner sides (n_inner, 2)
    inner_normals: Floats  # unit normals (n_inner, dim) from the first cell to the second
    inner_sizes: Floats  # lengths or areas (n_inner,)
    outer: Ints  # cells of outer sides (n_outer,)
    normals: Floats  # outward unit normals (n_outer, dim)
    sizes: Floats  # lengths or areas (n_outer,)
    shares: sp.csr_matrix  # integrals of basis functions over outer sides (n_outer, n_nodes)
    joints: Joints  # opposite sides at interfaces
    numbers: Callable[[Ints], Ints]
    """map from edges (k, 2) or faces (k,) to positions in `outer`"""
    corners: tuple[Ints, Floats]  # offsets (n_cells + 1,) and coordinates (c, dim) of corners
    edges: tuple[Ints, Ints]  # cells (e,) and end nodes (e, 2) of edges
    arms: tuple[Ints, Floats]
    """cells (k,) of simplices, and vectors (k, dim, dim) from centroids of cells to corners"""

    def depths(self, cells: Ints, normals: Floats) -> Floats:
        """Return the widths of cells along the normals."""
        if len(cells) == 0:
            return np.zeros(0)
        offsets, corners = self.corners
        counts = np.diff(offsets)[cells]
        height = np.einsum("ki,ki->k", corners[spans(offsets[cells], counts)], np.repeat(normals, counts, axis=0))
        first = np.cumsum(counts) - counts
        width = np.maximum.reduceat(height, first) - np.minimum.reduceat(height, first)
        return np.asarray(width / np.linalg.norm(normals, axis=1))


class Residuals:
    """The residuals of states of a posed scene."""

    def __init__(self, posed: PosedScene):
        mesh, space = posed.space.mesh, posed.space
        space.refuse_revolution("error estimates")
        self.posed, self.mesh = posed, mesh
        self.sides = sides = _in_space(posed, mesh) if isinstance(mesh, PolyhedralMesh) else _in_plane(posed)
        elastic = elastic_matrix(posed.material.moduli, space.dim)
        self.compliance = np.asarray(np.linalg.inv(elastic))
        self.shear, self.sizes = 0.5 * mean_shear(elastic), extents(*sides.arms)
        one, two = (sides.depths(cells, sides.inner_normals) for cells in sides.inner.T)
        mu = 0.5 * self.shear[sides.inner].sum(axis=1)
        # The weights are |e| d_e / (4 mu) on inner and d_e / (2 mu) on outer sides.
        self.jump_weights = 0.5 * (one + two) / (4.0 * mu) * sides.inner_sizes
        self.weights = sides.depths(sides.outer, sides.normals) / (2.0 * self.shear[sides.outer])
        corners = sides.shares.tocoo()
        self.free = posed.supports.free_directions(corners.col.astype(np.int64), corners.row.astype(np.int64))
        self.constant = CONSTANT if space.in_plane else IN_SPACE

    def indicators(self, now: Instant) -> dict[str, Floats]:
        """Return the parts of eta_K^2 by name."""
        posed, pressure = self.posed, {}
        strain = strains(posed.space, now.u)
        sigma = stresses(posed.material.moduli, strain)
        sigma += 0.0 if posed.prestress is None else posed.prestress.stress(now.t)
        missed, data = posed.material.stabilisation_energies(posed.space, now.u), self.data(now, strain)
        if not posed.space.in_plane:
            counts = np.diff(self.sides.corners[0])
            missed *= SPATIAL_FACTOR * np.cbrt(self.mesh.measures) / (self.mesh.diameters * counts)
            q = self._pressures(sigma, now)
            sigma[:, : posed.space.dim] += q[:, None]
            pressure = {"pressure": self._expansions * q**2}
        jumps = self.jump_weights * np.sum(self._jump(sigma) ** 2, axis=1)
        rest = self.weights / self.sides.sizes * np.sum(self._rest(sigma, now) ** 2, axis=1)
        squared, count, force = self.constant**2, len(sigma), np.sum(body_forces(posed, now.t) ** 2, axis=1)
        return {
            "volume": squared * POINCARE * self.sizes**2 / self.shear / self.mesh.measures * force,
            "jumps": squared * totals(self.sides.inner.ravel(), np.repeat(0.5 * jumps, 2), count),
            "boundary": squared * totals(self.sides.outer, rest, count),
            **pressure,
            "stabilisation": np.maximum(missed, self._along(now.u, strain)),
            "data": data,
        }

    def _jump(self, sigma: Floats) -> Floats:
        one, two = self.sides.inner.T
        return tractions(sigma[one] - sigma[two], self.sides.inner_normals)

    def _rest(self, sigma: Floats, now: Instant) -> Floats:
        """Return forces minus stress resultants on outer sides, in free directions."""
        sides = self.sides
        stress = sides.sizes[:, None] * tractions(sigma[sides.outer], sides.normals)
        force = self._tractions(now.t) + self.contact(now) + self._springs(now.u)
        force += sides.joints.normal_forces(stress, self.weights, sides.normals)
        return np.asarray(np.einsum("bij,bj->bi", self.free, force - stress))

    def _along(self, u: Floats, strain: Floats) -> Floats:
        """Return the sum over edges in eta_K^2, for each cell."""
        (cell, ends), dim = self.sides.edges, u.shape[1]
        along, moved = np.diff(self.mesh.points[ends], axis=1)[:, 0], np.diff(u[ends], axis=1)[:, 0]
        length = np.linalg.norm(along, axis=1)
        unit = along / length[:, None]
        pairs = [(i, i) for i in range(dim)] + [(0, 1), (1, 2), (0, 2)][: dim * (dim - 1) // 2]
        dyad = np.column_stack([unit[:, i] * unit[:, j] for i, j in pairs])
        missed = np.einsum("ed,ed->e", moved, along) / length**2 - np.einsum("ek,ek->e", dyad, strain[cell])
        young = 1.0 / np.einsum("ei,eij,ej->e", dyad, self.compliance[cell], dyad)
        section = self.mesh.measures[cell] / self.sides.depths(cell, unit)
        return totals(cell, section * young / (3.0 * 2.0 ** (dim - 1)) * missed**2 * length, len(strain))

    @property
    def _expansions(self) -> Floats:
        """The integrals of I : C^{-1} I over cells."""
        dim = self.posed.space.dim
        return self.mesh.measures * self.compliance[:, :dim, :dim].sum(axis=(1, 2))

    def _pressures(self, sigma: Floats, now: Instant) -> Floats:
        """Return q with low accuracy, because the estimate holds with any q."""
        from scipy.sparse.linalg import lsmr

        roots, borne, units = self._pressure_problem
        jump, rest = self._jump(sigma) * self.sides.inner_normals, self._rest(sigma, now) * self.sides.normals
        left = roots * np.append(jump.sum(axis=1), rest.sum(axis=1))
        return units * lsmr(borne, np.append(left, np.zeros(len(sigma))), atol=1e-3, btol=0.0)[0]

    @cached_property
    def _pressure_problem(self) -> tuple[Floats, sp.csr_array, Floats]:
        """The least-squares problem for q: weights of rows, scaled matrix, scales of columns."""
        sides, weights, joints = self.sides, self.weights, self.sides.joints
        across = np.arange(len(sides.outer))
        one, other = joints.first[joints.bonded], joints.second[joints.bonded]
        across[one], across[other] = other, one
        bonded = across != np.arange(len(across))
        share = np.where(bonded, weights[across] / (weights + weights[across]), 1.0)
        free = np.einsum("bi,bij,bj->b", sides.normals, self.free, sides.normals)
        outer = np.sqrt(np.divide(weights, sides.sizes * free, out=np.zeros(len(free)), where=free > SAME))
        roots = self.constant * np.append(np.sqrt(self.jump_weights), outer)
        pick = sp.eye_array(self.mesh.n_cells, format="csr")
        inside, outside = (pick[side] for side in sides.inner.T)
        own = pick[sides.outer] - sp.diags_array(1.0 * bonded) @ pick[sides.outer[across]]
        borne = sp.diags_array(roots) @ sp.vstack([outside - inside, sp.diags_array(sides.sizes * free * share) @ own])
        borne = sp.vstack([borne, sp.diags_array(np.sqrt(self._expansions))])
        units = 1.0 / np.sqrt(borne.multiply(borne).sum(axis=0))
        return roots, sp.csr_array(borne @ sp.diags_array(units)), units

    def contact(self, now: Instant) -> Floats:
        """Return the contact forces on outer sides."""
        terms, obstacles = self.posed.terms, self.posed.obstacles
        friction = -np.einsum("mb,mbd->md", now.lam, terms.tangents) / terms.lengths[:, None]
        force = self._on_sides(terms, friction)
        force -= self._on_sides(obstacles, (now.p / obstacles.lengths)[:, None] * obstacles.normals)
        return force + self.sides.joints.reaction(force)

    def _tractions(self, t: float) -> Floats:
        force = np.zeros(self.sides.normals.shape)
        for load in self._loads:
            if load.edges is not None:
                np.add.at(force, self.sides.numbers(load.edges), load.forces(t))
        return force

    @property
    def _loads(self) -> list[Load]:
        return [load for load in self.posed.loads if isinstance(load, Load)]

    def _on_sides(self, rows: ContactRows, values: Floats) -> Floats:
        """Return forces on outer sides, given forces per area of contact rows."""
        sides, ends, force = self.sides, rows.ends.tocoo(), np.zeros(self.sides.normals.shape)
        at = sides.numbers(rows.names[ends.col])
        np.add.at(force, at, ends.data[:, None] * values[ends.row])
        # At interfaces, scale forces up if nodes of a side have no contact row.
        joined = sides.joints.first
        known = totals(at, ends.data, len(force))[joined]
        force[joined] *= np.divide(sides.sizes[joined], known, out=np.ones(len(known)), where=known > 0)[:, None]
        return force

    def _springs(self, u: Floats) -> Floats:
        springs, force = self.posed.springs, np.zeros(self.sides.normals.shape)
        if springs is None:
            return force
        stiff = springs.diagonal().reshape(u.shape).max(axis=1) > 0
        shares = self.sides.shares
        sprung = np.logical_and.reduceat(stiff[shares.indices], shares.indptr[:-1])
        share = np.asarray(shares[sprung].sum(axis=0)).ravel()
        pull = -(springs @ u.ravel()).reshape(u.shape) / np.where(share > 0, share, 1.0)[:, None]
        force[sprung] = shares[sprung] @ pull
        return force

    @cached_property
    def _reader(self) -> Reader:
        return Reader(self.posed, skeleton(self.posed))

    @cached_property
    def _parts(self) -> list[Contribution]:
        return list_parts(self.posed, self.posed.space)

    def data(self, now: Instant, strain: Floats) -> Floats:
        """Return the part of eta_K^2 due to errors of assembled data."""
        sides, count, (offsets, x) = self.sides, len(self.sides.outer), self.sides.corners
        # int_K (f - f_K)^2 is about |K| / 3 times the mean of (f - f_K)^2 over vertices.
        owner, found = cell_of_corner(offsets), np.zeros(self.mesh.n_cells)
        weights = (self.mesh.measures / 3.0 / np.diff(offsets))[owner]
        if varies_in_place(self._parts):
            apart, C = compare_stresses(self.posed, self._parts, (x, owner), now.t, strain)
            squares = np.einsum("qi,qi->q", apart, np.linalg.solve(C, apart[..., None])[..., 0])
            found += totals(owner, weights * squares, self.mesh.n_cells)
        if self.posed.space.in_plane:
            means = self._tractions(now.t) / sides.sizes[:, None]
            found += totals(sides.outer, self._reader.local_errors(now, means), self.mesh.n_cells)
        for load in (load for load in self._loads if callable(load.value)):
            if load.edges is not None and not self.posed.space.in_plane:
                at, size, forces = sides.numbers(load.edges), load.measures, load.forces(now.t)
                whole, area = np.zeros(sides.normals.shape), totals(at, size, count)
                np.add.at(whole, at, forces)
                apart = forces / size[:, None] - whole[at] / area[at, None]
                squares = totals(at, size * np.sum(apart**2, axis=1), count)
                found += totals(sides.outer, self.weights * squares, self.mesh.n_cells)
            elif load.cells is not None:
                middle = load.in_cells(self.mesh.centroids, np.arange(self.mesh.n_cells), now.t)
                apart = (load.in_cells(x, owner, now.t) - middle[owner]).reshape(len(owner), -1)
                within = totals(owner, weights * np.sum(apart**2, axis=1), self.mesh.n_cells)
                found += POINCARE * self.sizes**2 / self.shear * within
        return found


def _in_plane(posed: PosedScene) -> MeshSides:
    edges = skeleton(posed)
    mesh = edges.mesh
    ends = mesh.points[edges.sides[mesh.shared_edges.corners[mesh.shared_edges.first][mesh.shared_edges.counts == 2]]]
    inside_normals = right_of(np.diff(ends, axis=1)[:, 0])
    length = np.linalg.norm(inside_normals, axis=1)
    side, nodes = np.repeat(np.arange(len(edges.outer)), 2), edges.outer_edges.ravel()
    shares = sp.csr_matrix((np.repeat(0.5 * edges.lengths, 2), (side, nodes)), shape=(len(edges.outer), mesh.n_nodes))
    return MeshSides(
        inner=mesh.neighbours,
        inner_normals=inside_normals / length[:, None],
        inner_sizes=length,
        outer=edges.outer,
        normals=edges.units,
        sizes=edges.lengths,
        shares=shares,
        joints=edges.joints,
        numbers=lambda sides: positions(sides, edges.outer_edges, mesh.n_nodes),
        corners=(mesh.offsets, mesh.points[mesh.vertices]),
        edges=(edges.owner, edges.sides),
        arms=(edges.owner, mesh.points[edges.sides] - mesh.centroids[edges.owner, None]),
    )


def _in_space(posed: PosedScene, mesh: PolyhedralMesh) -> MeshSides:
    inner, outer = np.flatnonzero(mesh.face_cells[:, 1] >= 0), mesh.boundaries["boundary"]
    corners = rows_in_order(mesh.face_offsets, mesh.face_vertices, outer)

    def numbers(sides: Ints) -> Ints:
        return np.searchsorted(outer, sides if sides.ndim == 1 else sides[:, 1])

    groups = list(face_groups(mesh.points, mesh.face_offsets, mesh.face_vertices, outer))
    side = np.concatenate([np.repeat(numbers(group.faces), group.nodes.shape[1]) for group in groups])
    nodes, shares = (np.concatenate([getattr(group, name).ravel() for group in groups]) for name in ("nodes", "shares"))
    rows, vertices, cells = list_faces(mesh.faces)
    cell, after = cell_of_corner(cells)[cell_of_corner(rows)], vertices[next_corner(rows)]
    edges = np.unique(np.column_stack([cell, np.sort(np.column_stack([vertices, after]), axis=1)]), axis=0)
    tips = np.column_stack([vertices[rows[cell_of_corner(rows)]], vertices, after])
    offsets, within = mesh.cell_nodes
    return MeshSides(
        inner=mesh.face_cells[inner],
        inner_normals=mesh.face_normals[inner],
        inner_sizes=mesh.face_areas[inner],
        outer=mesh.face_cells[outer, 0],
        normals=mesh.face_normals[outer],
        sizes=mesh.face_areas[outer],
        shares=sp.csr_matrix((shares, (side, nodes)), shape=(len(outer), mesh.n_nodes)),
        joints=_joints_in_space(posed, mesh, outer, corners),
        numbers=numbers,
        corners=(offsets, mesh.points[within]),
        edges=(edges[:, 0], edges[:, 1:]),
        arms=(cell, mesh.points[tips] - mesh.centroids[cell, None]),
    )


def _joints_in_space(posed: PosedScene, mesh: PolyhedralMesh, outer: Ints, corners: tuple[Ints, Ints]) -> Joints:
    first, second, bonded = [outer[:0]], [outer[:0]], [np.zeros(0, dtype=bool)]
    for joint in mesh.interfaces.values():
        first.append(faces_of(joint.edges, corners))
        second.append(faces_of(joint.partners, corners))
        there = joint.edges >= 0
        normals = np.repeat(mesh.face_normals[outer[first[-1]]], there.sum(axis=1), axis=0)[:, None]
        normal = jump_rows(joint.edges[there], joint.partners[there], normals, mesh.points)
        held = np.ones(there.shape, dtype=bool)
        held[there] = np.diff(posed.supports.on_free(normal).indptr) == 0
        bonded.append(np.asarray(held.all(axis=1)))
    return Joints(np.empty((0, 2), dtype=np.int64), *map(np.concatenate, (first, second, bonded)))
