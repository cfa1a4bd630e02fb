"""Scenes and meshes for many tests, and marks that decide which cases of a test run by default."""

from __future__ import annotations

from functools import cache, partial

import numpy as np
import pytest

import vemcvx as vx

FAMILIES = tuple(vx.meshes.FAMILIES)
SEEDED = ("squares", "triangles", "voronoi", "hexagons", "distorted", "nonconvex", "hanging")
"""Families of random scenes. A new name would change the scenes of all seeds."""
OF_TRIANGLES = ("triangles",)
"""Families of linear triangles, which lock near incompressibility and need no stabilisation."""


def mostly_long(names, values, *kept, ids=None, others=pytest.mark.long):
    """Return a parametrisation. Cases outside `kept` (indices or ids, by default 0) get the mark `others`."""
    cases, ids = [], ids if callable(ids) or ids is None else list(ids)
    for k, value in enumerate(values):
        is_case = isinstance(value, type(pytest.param()))
        case = value if is_case else pytest.param(*(value if "," in names else (value,)))
        word = "-".join(str(ids(one)) for one in case.values) if callable(ids) else ids[k] if ids else case.id
        first = case.values[0] if isinstance(case.values[0], str) else k
        marks = [*case.marks, *([] if {k, word, first} & set(kept or [0]) else [others])]
        cases.append(pytest.param(*case.values, marks=marks, id=word))
    return pytest.mark.parametrize(names, cases)


mostly_slow = partial(mostly_long, others=pytest.mark.slow)


def long_cases(suite, is_long):
    """Mark the cases of a suite as long if `is_long(name)` is true, and return the suite."""
    (mark,) = (mark for mark in suite.pytestmark if mark.name == "parametrize")
    marks = {True: pytest.mark.long, False: ()}
    mark.args[1][:] = [pytest.param(*one.values, id=one.id, marks=marks[is_long(one.id)]) for one in mark.args[1]]
    return suite


MARKS = {"voronoi": (), "hanging": pytest.mark.long}
few_families = pytest.mark.parametrize(
    "family", [pytest.param(name, marks=MARKS.get(name, pytest.mark.slow)) for name in FAMILIES]
)
any_family = mostly_long("family", FAMILIES, "voronoi")


def paper_load(course):
    """Return the traction of Section 4 of the paper (Feng, Han, Huang), with course(t) in place of t."""

    def pull(x, t):
        return np.column_stack([8 * (1.25 - x[:, 1]) * course(t), np.full(len(x), -0.01 * course(t))])

    return pull


def paper_scene(course=lambda t: t, bound=4.0, quadrature="nodes"):
    """Return the scene of Section 4 of the paper (Feng, Han, Huang)."""
    return vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(paper_load(course), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, on="bottom", quadrature=quadrature),
    )


def monotone(t):
    """Return the factor of a load that only grows."""
    return t


def cyclic(t):
    """Return the factor of a load that grows, reverses and grows again."""
    return np.sin(2 * np.pi * t)


def drawn(family, seed):
    """Return `family`, or for every eighth seed a family outside `SEEDED`."""
    added = [name for name in FAMILIES if name not in SEEDED]
    return added[seed // 8 % len(added)] if added and seed % 8 == 7 else family


def rotation(angle):
    """Return the matrix that rotates the plane anticlockwise."""
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def moved(mesh, matrix, shift=0.0):
    """Return a mesh whose points are multiplied by a matrix, then shifted."""
    named = {name: part for name, part in mesh.boundaries.items() if name not in (*mesh.interfaces, "boundary")}
    kept = {"boundaries": named, "cell_data": mesh.cell_data, "interfaces": dict(mesh.interfaces)}
    return type(mesh)(mesh.points @ np.asarray(matrix).T + shift, mesh.cells, **kept)


@cache
def small(family, n=6, **options):
    """Return a read-only mesh of the unit square with about n cells per side."""
    return vx.meshes.FAMILIES[family](n, **options)
