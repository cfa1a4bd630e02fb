r"""The distance of two displacement fields u and v in the energy norm.

C is the elastic tensor of u, and Pi u the projection of u to linear functions in each cell. The three kinds of
distances are

- exact: $(\int C \varepsilon(u - v) : \varepsilon(u - v))^{1/2}$, on triangles, rectangles and tetrahedra;
- projected: the same integral for Pi u and Pi v, on any cells;
- nodal: the norm $|w|$ below, for w = u - v at the nodes of the mesh of u, which must be nodes of the mesh of v.

With the cells K of u, and the stabilisation S_K, the norm (3.13) of Feng, Han and Huang is

$$ |w|^2 = \sum_K |K| \, \varepsilon(\Pi w) : C \varepsilon(\Pi w) + S_K(w - \Pi w, w - \Pi w). $$

In the plane, exact and projected distances have no quadrature error. In space, they have none if the cells of the mesh
of v lie inside cells of the mesh of u. For other meshes in space, the quadrature error is O(h).

Virtual functions are linear on triangles and tetrahedra. Let a rectangle have the sides e_1 and e_2, the centre c, and
the values u_1 ... u_4 at successive vertices. With xi = 2 e_1.(x - c) / |e_1|^2 and eta = 2 e_2.(x - c) / |e_2|^2,

$$ u(x) = \bar u + \nabla(\Pi u) (x - c) + b \, \xi \eta, \qquad b = (u_1 - u_2 + u_3 - u_4) / 4, $$

with the mean $\bar u$ of u_1 ... u_4. The function xi eta is harmonic, and linear on the sides. In other cells, only
Pi u is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from vemcvx.base.arrays import (
    SAME,
    Bools,
    Floats,
    Ints,
    as_real_array,
    brief,
    choice,
    finite,
    flag,
    number,
    totals,
)
from vemcvx.base.errors import HistoryError, MeshError
from vemcvx.meshes import Mesh, PolygonMesh, PolyhedralMesh
from vemcvx.meshes.polygons import DEGREE_2_POINTS, cell_of_corner, nearest, outlines, overlaps, places, triangulate
from vemcvx.results import Results
from vemcvx.vem import CellGroup, Space, Stabilisation, strains
from vemcvx.vem.elasticity import cell_energies, softest_shear
from vemcvx.vem.points_in_solids import solid_places
from vemcvx.vem.stabilisation import stabilisation_of
from vemcvx.vem.tensors import elastic_matrix, stresses


def evaluate_strain(field: Field, kind: str, subject: str, cells: Ints, points: Floats) -> Floats:
    """Return the strain at each point, of u if `kind` is "exact", else of Pi u."""
    plane = field.space.in_plane
    known = "neither a triangle nor a rectangle" if plane else "no tetrahedron"
    slope = np.zeros((field.mesh.n_cells, field.space.dim, field.strain.shape[1]))
    for group in field.space.groups if kind == "exact" else ():
        n = group.nodes.shape[1]
        bad = ~_rectangles(group.corners) if plane and n == 4 else np.full(len(group.cells), not group.simplices)
        if bad.any():
            raise MeshError(
                f"{subject}: cell {group.cells[bad][0]}, of {n} vertices, is {known}. Inside "
                "other cells, displacements are unknown. Measure their projections by kind='projected'."
            )
        if plane and n == 4:
            slope[group.cells] = _slopes(group, field.displacement)
    off_centre = np.einsum("qk,qkl->ql", points - field.mesh.centroids[cells], slope[cells])
    return np.asarray(field.strain[cells] + off_centre)


def _rectangles(corners: Floats) -> Bools:
    first, second = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    lengths = np.hypot(*first.T), np.hypot(*second.T)
    closes = np.abs(corners[:, 0] - corners[:, 1] + corners[:, 2] - corners[:, 3]).max(axis=1)
    skew = np.abs(np.sum(first * second, axis=1)) / np.maximum(*lengths)
    return np.maximum(closes, skew) <= 1e-10 * np.minimum(*lengths)


def _slopes(group: CellGroup, displacement: Floats) -> Floats:
    """Return the strain gradients of b xi eta on rectangles."""
    corners, u = group.corners, displacement[group.nodes]
    b = 0.25 * ((u[:, 0] - u[:, 1]) + (u[:, 2] - u[:, 3]))
    sides = [corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]]
    g, h = (2.0 * side / np.sum(side**2, axis=1)[:, None] for side in sides)
    # With g = grad xi and h = grad eta, the derivative of grad(xi eta) along x_k is g_k h + h_k g.
    turn = g[:, :, None] * h[:, None, :] + h[:, :, None] * g[:, None, :]
    xx, yy = b[:, None, 0] * turn[:, :, 0], b[:, None, 1] * turn[:, :, 1]
    return np.stack([xx, yy, b[:, None, 0] * turn[:, :, 1] + b[:, None, 1] * turn[:, :, 0]], axis=2)


@dataclass(frozen=True, eq=False)
class Field:
    """A displacement field.

    Parameters
    ----------
    mesh : PolygonMesh or PolyhedralMesh
    displacement : (n_nodes, dim) array
        Displacements of the nodes.
    moduli : (2, n_cells), (6, n_cells) or, in space, (21, n_cells) array
        As in `History.moduli`.
    time : float
        The instant of the field.
    stabilisation : {"shear", "unit"}, a vx.Stabilisation, or None
        The stabilisation in nodal distances, as for `Elasticity`.

    Raises
    ------
    HistoryError
        The arrays do not fit the mesh.

    Examples
    --------
    >>> mesh = vx.meshes.squares(1)
    >>> print(vx.measures.Field(mesh, mesh.points, np.ones((2, 1))).strain.round(9))
    [[1. 1. 0.]]
    """

    mesh: Mesh
    displacement: Floats
    moduli: Floats
    time: float = 0.0
    stabilisation: str | Stabilisation | None = "shear"

    def __post_init__(self) -> None:
        if not isinstance(self.mesh, (PolygonMesh, PolyhedralMesh)):
            raise HistoryError(f"Field: found mesh = {brief(self.mesh)}; wanted a PolygonMesh or a PolyhedralMesh.")
        number(self.time, "Field: found time", "the instant, a finite number")
        for name in ("displacement", "moduli"):
            values = as_real_array(getattr(self, name), f"Field: {name}", "numbers, as many as fit the mesh")
            finite(values, f"Field: {name}")
            object.__setattr__(self, name, values)
        nodes, cells = self.mesh.points.shape, self.mesh.n_cells
        if np.shape(self.displacement) != nodes:
            raise HistoryError(f"Field: found displacements {np.shape(self.displacement)}; this mesh needs {nodes}.")
        full = 6 if nodes[1] == 2 else 21
        if np.shape(self.moduli) not in ((2, cells), (full, cells)):
            raise HistoryError(
                f"Field: found moduli {np.shape(self.moduli)}; wanted (2, {cells}), lambda and mu of every cell, or "
                f"({full}, {cells}), the upper triangle of its elastic matrix."
            )
        if not (self.stabilisation is None or isinstance(self.stabilisation, Stabilisation)):
            choice(self.stabilisation, "Field", "stabilisation", ("shear", "unit"), HistoryError)

    @cached_property
    def space(self) -> Space:
        """The virtual element space on the mesh."""
        return Space(self.mesh)

    @cached_property
    def strain(self) -> Floats:
        """The strains of Pi u (n_cells, 3): e_xx, e_yy, 2 e_xy; in space (n_cells, 6), in the order of stresses."""
        return strains(self.space, self.displacement)


def field_of(run: Results | Field, step: int, subject: str) -> Field:
    """Return the field of a history at a stored step, or the given field."""
    if isinstance(run, Field):
        return run
    if not isinstance(run, Results):
        raise HistoryError(f"{subject}: found {brief(run)}; wanted a History or a vx.measures.Field.")
    run._space.refuse_revolution(subject)
    row = run.row(step)
    return Field(run.mesh, run.displacement[row], run.moduli, float(run.times[row]), run.stabilisation)


def step_at(history: Results, time: float) -> int:
    """Return the stored step at an instant, or raise HistoryError."""
    time, times = number(time, "history: found time", "an instant, a finite number"), history.times
    nearest = int(np.argmin(np.abs(times - time)))
    span = float(history.trajectory.times[-1] - history.trajectory.times[0])
    # Equal instants of two runs may differ by rounding.
    if abs(times[nearest] - time) > SAME * span:
        raise HistoryError(
            f"history: no step was stored at t = {time:.9g}; the nearest is step {history.stored[nearest]} at "
            f"t = {times[nearest]:.9g}. Simulate with times that contain this instant, or with store='all'."
        )
    return int(history.stored[nearest])


@dataclass(frozen=True, eq=False)
class Measured:
    """An error or a distance.

    Attributes
    ----------
    absolute : float
        The norm of the difference. Energy norms are (int C eps : eps dx)^(1/2), in units of sqrt(force * length). In
        Feng, Han and Huang, ||v||_E is smaller by the factor sqrt(2).
    reference : float
        The norm of the reference.
    cells : (n_cells,) array
        The norms on the cells of the first mesh; the sum of squares is absolute^2.

    Examples
    --------
    >>> vx.measures.Measured(0.1, 2.0, np.array([0.1])).relative
    0.05
    """

    absolute: float
    reference: float
    cells: Floats

    @property
    def relative(self) -> float:
        """The ratio absolute / reference, where 0 / 0 = 0."""
        if self.reference == 0.0:
            return 0.0 if self.absolute == 0.0 else float("inf")
        return self.absolute / self.reference


def make_measure(squares: Floats, reference: float) -> Measured:
    """Return the measure from the squared norms on cells and the squared reference."""
    cells = np.sqrt(np.maximum(squares, 0.0))
    return Measured(float(np.sqrt(np.sum(cells**2))), float(np.sqrt(max(reference, 0.0))), cells)


@dataclass(frozen=True, eq=False)
class CommonRule:
    """A quadrature rule on the overlaps of two meshes."""

    first: Ints  # cells of the first mesh (q,)
    second: Ints  # cells of the second mesh (q,)
    weights: Floats  # weights (q,), some negative in nonconvex cells
    points: Floats  # points (q, dim)


@lru_cache(maxsize=4)
def common_rule(first: Mesh, second: Mesh) -> CommonRule:
    """Return a quadrature rule, of degree 2 in the plane and 0 in space."""
    if isinstance(second, PolyhedralMesh):
        return _in_pyramids(first, second)
    assert isinstance(first, PolygonMesh)
    i, j, shared = overlaps(*(outlines(mesh.points, *mesh.cell_nodes) for mesh in (first, second)))
    corners, areas, owner = triangulate(shared)
    points = places(corners, DEGREE_2_POINTS).reshape(-1, 2)
    return CommonRule(np.repeat(i[owner], 3), np.repeat(j[owner], 3), np.repeat(areas / 3.0, 3), points)


def _in_pyramids(first: Mesh, second: PolyhedralMesh) -> CommonRule:
    """Return the rule with one point in each pyramid over a face of the second mesh."""
    assert isinstance(first, PolyhedralMesh)
    cell, face = cell_of_corner(second.cell_offsets), second.cell_faces
    arms = second.face_centroids[face] - second.centroids[cell]
    weights = second.face_signs * second.face_areas[face] / 3.0 * np.sum(arms * second.face_normals[face], axis=1)
    # A pyramid outside a nonconvex cell has a negative weight.
    points = second.centroids[cell] + 0.75 * arms
    held = solid_places(Space(first), first, points)[1]
    found = np.flatnonzero(np.diff(held.indptr))
    holder = held.indices[held.indptr[found]].astype(np.int64)
    return CommonRule(holder, cell[found], weights[found], points[found])


def check_covered(rule: CommonRule, first: Mesh, second: Mesh, subject: str) -> None:
    """Raise MeshError unless both meshes cover the same domain."""
    sizes = [float(first.measures.sum()), float(second.measures.sum()), float(rule.weights.sum())]
    if max(sizes) - min(sizes) > 1e-8 * max(sizes):
        what = "area" if isinstance(first, PolygonMesh) else "volume"
        raise MeshError(
            f"{subject}: the first mesh has the {what} {sizes[0]:.6g}, the second {sizes[1]:.6g}, and they share "
            f"{sizes[2]:.6g}; both must cover the same domain. Give common=True to measure on the common part."
        )


KINDS = ("projected", "exact", "nodal")


def energy_distance(
    run: Results | Field,
    reference: Results | Field,
    *,
    kind: str = "projected",
    step: int = -1,
    reference_step: int = -1,
    time: float | None = None,
    common: bool = False,
) -> Measured:
    """Return the energy norm of the difference of two runs, also on different meshes.

    Parameters
    ----------
    run, reference : History or Field
        The compared runs; relative values refer to `reference`.
    kind : {"projected", "exact", "nodal"}
        The kind of distance, see :mod:`vemcvx.estimate.measures.distance`.
    step, reference_step : int
        Stored steps; negative numbers count from the end.
    time : float, optional
        A stored instant of both runs, in place of step numbers.
    common : bool
        True to measure on the common part of different domains.

    Returns
    -------
    Measured
        The norm uses the moduli of `run`.

    Raises
    ------
    MeshError
        The meshes do not cover the same domain, or do not admit `kind`.
    HistoryError
        No step was stored at `time`, or `run` lacks the stabilisation for a nodal distance.
    SceneError
        A step was not stored, or the body is a body of revolution.

    Examples
    --------
    >>> mesh, moduli = vx.meshes.squares(1), np.ones((2, 1))
    >>> u, v = (vx.measures.Field(mesh, factor * mesh.points, moduli) for factor in (1.0, 2.0))
    >>> round(vx.measures.energy_distance(u, v).relative, 9)
    0.5
    """
    subject = "energy_distance"
    choice(kind, subject, "kind", KINDS, HistoryError)
    common = flag(common, f"{subject}: common")
    if time is not None:
        step = step_at(run, time) if isinstance(run, Results) else step
        reference_step = step_at(reference, time) if isinstance(reference, Results) else reference_step
    u, v = field_of(run, step, subject), field_of(reference, reference_step, subject)
    if u.space.dim != v.space.dim:
        raise MeshError(f"{subject}: one mesh has polygons, the other polyhedra; give two meshes of one kind.")
    if kind == "nodal":
        return _nodal(u, v)
    rule = common_rule(u.mesh, v.mesh)
    if not common:
        check_covered(rule, u.mesh, v.mesh, subject)
    mine = evaluate_strain(u, kind, f"{subject} (first mesh)", rule.first, rule.points)
    there = evaluate_strain(v, kind, f"{subject} (second mesh)", rule.second, rule.points)
    apart, C = mine - there, u.moduli[:, rule.first]
    squares, norm = (rule.weights * np.sum(strain * stresses(C, strain), axis=1) for strain in (apart, there))
    return make_measure(totals(rule.first, squares, u.mesh.n_cells), float(norm.sum()))


def _nodal(u: Field, v: Field) -> Measured:
    if u.stabilisation is None:
        raise HistoryError(
            "energy_distance: the first run was read from files without its stabilisation, which the nodal distance "
            "needs; give vx.measures.Field(mesh, displacement, moduli, stabilisation=...) instead."
        )
    at_nodes = v.displacement[_find_nodes(u.mesh, v.mesh)]
    return make_measure(_cell_energies(u, u.displacement - at_nodes), float(_cell_energies(u, at_nodes).sum()))


def _find_nodes(coarse: Mesh, fine: Mesh) -> Ints:
    """Return the fine node at every coarse node, or raise MeshError."""
    if coarse is fine:
        return np.arange(coarse.n_nodes)
    away, node = nearest(fine.points, coarse.points)
    worst = int(np.argmax(away))
    # Nodes are treated as equal within 1e-6 times the smallest cell diameter.
    if away[worst] > 1e-6 * min(coarse.diameters.min(), fine.diameters.min()):
        raise MeshError(
            f"energy_distance: node {worst} of the first mesh, at {coarse.points[worst]}, is no node of the second: "
            f"the nearest is {away[worst]:.3g} away. The nodal distance needs the coarse run first and a nested fine "
            "run as reference; kind='projected' accepts any two meshes."
        )
    return node


def _cell_energies(field: Field, w: Floats) -> Floats:
    """Return the energies (n_cells,) of w with the material of a field."""
    own = field.stabilisation
    assert own is not None
    if isinstance(own, str):
        own = stabilisation_of(own, 0.5 * softest_shear(elastic_matrix(field.moduli, field.space.dim)))
    return cell_energies(field.space, field.moduli, own, w)
