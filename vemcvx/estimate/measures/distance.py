"""How far two runs are apart, in the energy norm, on whatever meshes.

    exact       ( int C eps(u - v) : eps(u - v) dx )^(1/2) of the virtual functions, on rectangles and triangles
    projected   ( int C (eps(Pi u) - eps(Pi v)) : (eps(Pi u) - eps(Pi v)) dx )^(1/2), on any polygons
    nodal       |u - I v|_{a^h} on the mesh of u, where its nodes are nodes of the other, whose values there I v takes

The first two integrate on the overlaps of the cells, exactly: strains are linear or constant on each. They are norms of
a difference in one space of strains, hence symmetric where the moduli are the same, and obey the triangle inequality.
The nodal distance misses what v does between the coarse nodes, and is the smallest of the three. Cell by cell, with tau
the smallest shear stiffness, 2 mu if isotropic,

    |w|^2 = sum_K |K| eps(Pi w) : C eps(Pi w) + tau sum_i |w(x_i) - Pi w(x_i)|^2,    (3.13).
"""

from __future__ import annotations

import logging

import numpy as np

from vemcvx.arguments import choice, flag
from vemcvx.arrays import Floats, Ints, totals
from vemcvx.errors import HistoryError, MeshError
from vemcvx.estimate.measures.field import Field, Measured, field_of, measured, step_at
from vemcvx.estimate.measures.inner_strain import InnerStrain, projected_strain, virtual_strain
from vemcvx.estimate.measures.overlap import CommonRule, check_covered, common_rule
from vemcvx.meshes import PolygonMesh
from vemcvx.meshes.polygons.search import nearest
from vemcvx.results.results import Results
from vemcvx.vem import elastic_matrix, strains, stresses, upper_triangle
from vemcvx.vem.anisotropic import softest_shear
from vemcvx.vem.stabilisation import missed_squares

KINDS = ("projected", "exact", "nodal")
# Points at which strains and stresses are taken at once.
CHUNK = 2**18
# Moduli read at the centroids of different cells agree to round-off if they are the same constants.
SAME_MODULI = 1e-12
# Nodes are the same if they are closer than this part of the smallest cell's diameter.
SAME_NODE = 1e-6


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
    """Energy norm of the difference of two runs, on the same or on different meshes of one body.

    Parameters
    ----------
    run, reference : History or Field
        Shares of cells are those of the mesh of `run`; relative values refer to `reference`.
    kind : {"projected", "exact", "nodal"}
        What is compared: see :mod:`vemcvx.estimate.measures.distance`.
    step, reference_step : int
        Stored steps; negative ones count from the end.
    time : float, optional
        An instant that both runs have stored, instead of steps.
    common : bool
        Measure on what the meshes share, where they do not cover the same domain.

    Returns
    -------
    Measured
        Strains are weighed by the moduli of `run`; `moduli_apart` says how different those of `reference` are.

    Raises
    ------
    MeshError
        The meshes do not cover the same domain; "exact" on cells other than triangles and rectangles; "nodal" where
        nodes of `run` are no nodes of `reference`.
    HistoryError
        There is no such kind, or no step was stored at `time`.
    SceneError
        A step was not stored.
    """
    subject = "energy_distance"
    choice(kind, subject, "kind", KINDS, HistoryError)
    common = flag(common, f"{subject}: common")
    u, v = _field(run, step, time, subject), _field(reference, reference_step, time, subject)
    if kind == "nodal":
        return _nodal(u, v)
    if kind == "exact":
        fields = virtual_strain(u, f"{subject} (first mesh)"), virtual_strain(v, f"{subject} (second mesh)")
    else:
        fields = projected_strain(u), projected_strain(v)
    rule = common_rule(u.mesh, v.mesh, 2 if kind == "exact" else 0)
    if not common:
        check_covered(rule, u.mesh, v.mesh, subject)
    squares, norm = _integrals(rule, u.moduli, *fields)
    return measured(totals(rule.first, squares, u.mesh.n_cells), norm, _apart(rule, u, v))


def _field(run: Results | Field, step: int, time: float | None, subject: str) -> Field:
    if time is not None and isinstance(run, Results):
        step = step_at(run, time)
    return field_of(run, step, subject)


def _integrals(rule: CommonRule, moduli: Floats, u: InnerStrain, v: InnerStrain) -> tuple[Floats, float]:
    """The weighted squares (q,) of the difference at the points, and the squared norm of the reference."""
    squares, norm = np.empty(len(rule.weights)), 0.0
    for start in range(0, len(squares), CHUNK):
        part = slice(start, start + CHUNK)
        i, weights = rule.first[part], rule.weights[part]
        x = None if rule.points is None else rule.points[part]
        there = v.at(rule.second[part], x)
        apart, C = u.at(i, x) - there, moduli[:, i]
        squares[part] = weights * np.sum(apart * stresses(C, apart), axis=1)
        norm += float(weights @ np.sum(there * stresses(C, there), axis=1))
    return squares, norm


def _apart(rule: CommonRule, u: Field, v: Field) -> float:
    """The largest relative difference of elastic matrices at the same place."""
    mine, other = (upper_triangle(elastic_matrix(field.moduli)) for field in (u, v))
    if all((mine[:, :1] == C).all() for C in (mine, other)):
        return 0.0
    difference = np.abs(mine[:, rule.first] - other[:, rule.second]).max(axis=0)
    apart = float((difference / np.abs(mine).max(axis=0)[rule.first]).max())
    if apart <= SAME_MODULI:
        return 0.0
    logging.getLogger("vemcvx").warning(
        "energy_distance: the moduli of the two meshes differ by up to %.3g; those of the first are used", apart
    )
    return apart


def _nodal(u: Field, v: Field) -> Measured:
    """|u - I v|_{a^h} on the mesh of u, relative to |I v|_{a^h}."""
    at_nodes = v.displacement[_nested_nodes(u.mesh, v.mesh)]
    return measured(_cell_energies(u, u.displacement - at_nodes), float(_cell_energies(u, at_nodes).sum()))


def _nested_nodes(coarse: PolygonMesh, fine: PolygonMesh) -> Ints:
    """The node of the fine mesh at every node of the coarse one, (n_nodes,)."""
    if coarse is fine:
        return np.arange(coarse.n_nodes)
    away, node = nearest(fine.points, coarse.points)
    worst = int(np.argmax(away))
    if away[worst] > SAME_NODE * min(coarse.diameters.min(), fine.diameters.min()):
        raise MeshError(
            f"energy_distance: node {worst} of the first mesh, at {coarse.points[worst]}, is no node of the second: "
            f"the nearest is {away[worst]:.3g} away. The nodal distance wants the coarse run first and a nested fine "
            "one as reference; kind='projected' takes any two meshes."
        )
    return node


def _cell_energies(field: Field, w: Floats) -> Floats:
    """a_K^h(w, w) of nodal displacements w (n_nodes, 2), with the moduli of a field, cell by cell: (n_cells,)."""
    strain = strains(field.space, w)
    energy: Floats = field.mesh.areas * np.sum(strain * stresses(field.moduli, strain), axis=1)
    return energy + softest_shear(elastic_matrix(field.moduli)) * missed_squares(field.space, w)
