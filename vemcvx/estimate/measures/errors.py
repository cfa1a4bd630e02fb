"""Errors against closed forms, and tables of errors with observed orders of convergence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Floats, Ints, as_real_array, brief, totals
from vemcvx.base.errors import HistoryError
from vemcvx.base.table import Table
from vemcvx.effects import data
from vemcvx.estimate.measures.distance import Field, Measured, field_of, make_measure
from vemcvx.meshes import PolyhedralMesh
from vemcvx.meshes.polygons import (
    RADON_POINTS,
    RADON_WEIGHTS,
    cell_of_corner,
    next_corner,
    outlines,
    places,
    triangulate,
)
from vemcvx.meshes.polyhedra import list_faces
from vemcvx.results import Results
from vemcvx.vem import Space
from vemcvx.vem.tensors import stresses

# If two runs with sizes h_1, h_2 have the errors e_i = C h_i^p, the order is p = log(e_1 / e_2) / log(h_1 / h_2).


class Orders(NamedTuple):
    """The observed orders of convergence of m runs."""

    successive: Floats  # (m - 1,) orders between each run and the next
    slope: float  # slope of the least-squares line through (log h, log e)


def orders(h: ArrayLike, errors: ArrayLike) -> Orders:
    """Return observed orders of convergence p, such that errors are proportional to h^p.

    Parameters
    ----------
    h : (m,) sequence of positive numbers, no two neighbours equal
        Mesh sizes or steps, up to a constant factor.
    errors : (m,) sequence of positive numbers

    Returns
    -------
    Orders

    Raises
    ------
    HistoryError
        There are fewer than two runs, the lengths differ, or a number is not positive.

    Examples
    --------
    >>> print(vx.measures.orders([0.4, 0.2, 0.1], [0.16, 0.04, 0.01]).successive.round(9))
    [2. 2.]
    """
    x, y = (np.log(array) for array in check_runs(h, errors, "orders"))
    about = x - x.mean()
    return Orders(np.diff(y) / np.diff(x), float(about @ y / (about @ about)))


def check_runs(h: ArrayLike, errors: ArrayLike, subject: str, missing: bool = False) -> tuple[Floats, Floats]:
    """Return sizes and errors as arrays of positive numbers."""
    sizes, values = (as_real_array(raw, subject, "a sequence of numbers") for raw in (h, errors))
    if sizes.ndim != 1 or sizes.shape != values.shape or len(sizes) < 2:
        raise HistoryError(
            f"{subject}: found {sizes.shape} sizes and {values.shape} errors; give as many sizes as errors, at least 2."
        )
    for name, array in (("size", sizes), ("error", values[~np.isnan(values)] if missing else values)):
        wrong = ~(np.isfinite(array) & (array > 0))
        if wrong.any():
            raise HistoryError(f"{subject}: found the {name} {array[wrong][0]:.6g}; it must be finite and > 0.")
    twice = np.diff(np.log(sizes)) == 0
    if twice.any():
        raise HistoryError(f"{subject}: found the size {sizes[1:][twice][0]:.6g} twice in a row; give different sizes.")
    return sizes, values


# Let C be the elastic tensor, and u the known displacement. Pi u_h is the computed displacement, projected to linear
# functions in each cell K. The norms of the errors are
#
#     energy    ( sum_K int_K C (eps(u) - eps(Pi u_h)) : (eps(u) - eps(Pi u_h)) dx )^(1/2)
#     L2        ( sum_K int_K |u - Pi u_h|^2 dx )^(1/2)
#
# Quadrature has degree 5 in the plane, 2 in space. Degree 1 would miss errors: strains superconverge at centroids.


def energy_error(history: Results | Field, strain: data.Datum, step: int = -1) -> Measured:
    """Return the energy norm of the difference between computed and known strains.

    Parameters
    ----------
    history : History or Field
    strain : callable (x, t) -> (m, 3)
        Known strains e_xx, e_yy, 2 e_xy at points x (m, 2) and the instant t of the step. In space, (m, 6) strains
        e_xx, e_yy, e_zz, 2 e_xy, 2 e_yz, 2 e_xz.
    step : int
        A stored step; negative numbers count from the end.

    Returns
    -------
    Measured
        `reference` is the energy norm of the known strain.

    Raises
    ------
    SceneError
        The step was not stored, the strain has a wrong shape or is not finite, or the body is a body of revolution.

    Examples
    --------
    >>> mesh = vx.meshes.squares(1)
    >>> field = vx.measures.Field(mesh, mesh.points, np.ones((2, 1)))
    >>> bool(vx.measures.energy_error(field, lambda x, t: np.tile([1.0, 1.0, 0.0], (len(x), 1))).relative < 1e-12)
    True
    """
    field = field_of(history, step, "energy_error")
    x, weights, owner = _cell_rule(field.space)
    names = "e_xx, e_yy, 2 e_xy" if field.space.in_plane else "e_xx, e_yy, e_zz, 2 e_xy, 2 e_yz, 2 e_xz"
    exact = data.tensor(strain, x, field.time, f"energy_error: strain ({names})")
    moduli = field.moduli[:, owner]
    missed = exact - field.strain[owner]
    missed, exact = (np.sum(e * stresses(moduli, e), axis=1) for e in (missed, exact))
    return make_measure(totals(owner, weights * missed, field.mesh.n_cells), float(weights @ exact))


def l2_error(history: Results | Field, displacement: data.Datum, step: int = -1) -> Measured:
    """Return the L2 norm of the difference between computed and known displacements.

    Parameters
    ----------
    history : History or Field
    displacement : callable (x, t) -> (m, dim)
        Known displacements at points x (m, dim) and the instant t of the step.
    step : int
        A stored step; negative numbers count from the end.

    Returns
    -------
    Measured
        In units of length^2 (in space length^(5/2)); `reference` is the L2 norm of the known displacement.

    Raises
    ------
    SceneError
        The step was not stored, the displacement is not (m, dim) or not finite, or the body is a body of revolution.

    Examples
    --------
    >>> mesh = vx.meshes.squares(1)
    >>> field = vx.measures.Field(mesh, 2.0 * mesh.points, np.ones((2, 1)))
    >>> round(vx.measures.l2_error(field, lambda x, t: x).relative, 9)
    1.0
    """
    field = field_of(history, step, "l2_error")
    x, weights, owner = _cell_rule(field.space)
    exact = data.vector(displacement, x, field.time, "l2_error: displacement")
    missed = exact - field.space.project_values(x, np.arange(len(x)), owner) @ field.displacement
    missed, exact = (np.sum(u**2, axis=1) for u in (missed, exact))
    return make_measure(totals(owner, weights * missed, field.mesh.n_cells), float(weights @ exact))


def _cell_rule(space: Space) -> tuple[Floats, Floats, Ints]:
    """Return quadrature points, with the weight and the cell of each point."""
    mesh = space.mesh
    if isinstance(mesh, PolyhedralMesh):
        return _on_tetrahedra(mesh)
    triangles = triangulate(outlines(mesh.points, *mesh.cell_nodes))
    points = places(triangles.corners, RADON_POINTS).reshape(-1, 2)
    weights = triangles.areas[:, None] * RADON_WEIGHTS
    return points, weights.ravel(), np.repeat(triangles.owner, len(RADON_WEIGHTS))


def _on_tetrahedra(mesh: PolyhedralMesh) -> tuple[Floats, Floats, Ints]:
    rows, nodes, cells = list_faces(mesh.faces)
    at = cell_of_corner(rows)
    cell, face = cell_of_corner(cells)[at], mesh.cell_faces[at]
    ends = [mesh.points[nodes], mesh.points[nodes[next_corner(rows)]]]
    corners = np.stack([mesh.centroids[cell], mesh.face_centroids[face], *ends], axis=1)
    a, b, c = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)
    # Tetrahedra outside a cell that is not convex have negative volumes.
    volumes = np.einsum("ki,ki->k", a, np.cross(b, c)) / 6.0
    near = (5.0 - np.sqrt(5.0)) / 20.0
    points = near * corners.sum(axis=1)[:, None] + (1.0 - 4.0 * near) * corners
    return points.reshape(-1, 3), np.repeat(0.25 * volumes, 4), np.repeat(cell, 4)


@dataclass(frozen=True, eq=False, repr=False)
class ConvergenceTable:
    """A table of errors and observed orders, one row per size.

    Attributes
    ----------
    name : str
        The name of the sizes.
    sizes : (m,) array
    errors, orders : dict of str to (m,) array
        Errors and orders by name. The first order is NaN, because an order needs two runs.

    Examples
    --------
    >>> vx.measures.convergence_table([0.5, 0.25], [0.4, 0.2]).orders["error"]
    array([nan,  1.])
    """

    name: str
    sizes: Floats
    errors: dict[str, Floats]
    orders: dict[str, Floats]

    def markdown(self) -> str:
        """Return the table in Markdown."""
        return self._table().markdown()

    def csv(self) -> str:
        """Return the table as comma-separated values, with all digits; missing values are empty."""
        columns = [self.sizes, *(part[name] for name in self.errors for part in (self.errors, self.orders))]
        rows = zip(*(column.tolist() for column in columns), strict=True)
        heads = [self.name, *(head for name in self.errors for head in (name, f"order of {name}"))]
        return Table(heads, [["" if np.isnan(value) else value for value in row] for row in rows]).csv()

    def __repr__(self) -> str:
        return self.markdown().rstrip()

    def _repr_html_(self) -> str:
        return self._table().html()

    def _table(self) -> Table:
        rows = []
        for row, size in enumerate(self.sizes):
            words = [_fraction(size)]
            for name, errors in self.errors.items():
                error, order = errors[row], self.orders[name][row]
                words += ["" if np.isnan(error) else f"{error:#.4g}", "" if np.isnan(order) else f"{order:.2f}"]
            rows.append(words)
        return Table([self.name, *(head for name in self.errors for head in (name, "order"))], rows)


def convergence_table(h: ArrayLike, errors: ArrayLike | Mapping[str, ArrayLike], name: str = "h") -> ConvergenceTable:
    """Return a table of errors and observed orders, for Markdown or CSV.

    Parameters
    ----------
    h : (m,) sequence of positive numbers, no two neighbours equal
        Mesh sizes or steps.
    errors : (m,) sequence of positive numbers, or mapping of names to sequences
        Each sequence gives a column of errors and a column of orders. NaN stands for a missing error.
    name : str
        The name of the sizes.

    Returns
    -------
    ConvergenceTable

    Raises
    ------
    HistoryError
        There are fewer than two runs, the lengths differ, a number is not positive, or a name is no string.

    Examples
    --------
    >>> print(vx.measures.convergence_table([0.5, 0.25], [0.4, 0.2]).csv().splitlines()[0])
    h,error,order of error
    """
    given = errors if isinstance(errors, Mapping) else {"error": errors}
    for word in (name, *given):
        if not isinstance(word, str):
            raise HistoryError(f"convergence_table: found the name {brief(word)}; wanted a string.")
    if not given:
        raise HistoryError("convergence_table: found no errors; give a sequence, or a mapping of names to sequences.")
    values, rates = {}, {}
    for word, raw in given.items():
        sizes, values[word] = check_runs(h, raw, f"convergence_table: {word}", missing=True)
        rates[word] = np.append(np.nan, np.diff(np.log(values[word])) / np.diff(np.log(sizes)))
    return ConvergenceTable(name, sizes, values, rates)


def _fraction(size: float) -> str:
    """Format a size, if possible as a fraction such as 1/64."""
    parts = round(1.0 / size) if size > 1e-9 else 0
    return f"1/{parts}" if parts > 1 and abs(parts * size - 1.0) < 1e-12 else f"{size:.4g}"
