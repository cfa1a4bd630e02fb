"""Strains of Pi u and the rigid modes."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import small

import vemcvx as vx
from vemcvx.vem import Space, strains
from vemcvx.vem.elasticity import rigid_modes
from vemcvx.vem.loads import mean_strains


def test_strains_are_means_over_cells(family):
    """|K| eps is the sum over edges of the symmetric part of int u (x) n ds, for random nodal values of u."""
    mesh = small(family, 3)
    u = np.random.default_rng(0).standard_normal((mesh.n_nodes, 2))
    found = strains(Space(mesh), u.ravel())
    for cell, area, strain in zip(mesh.cells, mesh.areas, found, strict=True):
        chord = np.roll(mesh.points[cell], -1, axis=0) - mesh.points[cell]
        mean = 0.5 * (u[cell] + np.roll(u[cell], -1, axis=0))
        d = mean.T @ np.column_stack([chord[:, 1], -chord[:, 0]]) / area
        assert np.abs(strain - [d[0, 0], d[1, 1], d[0, 1] + d[1, 0]]).max() < 1e-11
    for mode in rigid_modes(mesh.points).T:
        assert np.abs(strains(Space(mesh), mode)).max() < 1e-13


def test_large_translations_change_no_bit_of_strains():
    """Sums u + 2^24 are exact on a grid of 2^-26."""
    mesh = vx.meshes.FAMILIES["voronoi"](4)
    u = np.round(mesh.points * 2**26) / 2**26
    assert np.array_equal(strains(Space(mesh), u + 2.0**24), strains(Space(mesh), u))


@pytest.mark.parametrize("family", [*vx.meshes.FAMILIES, *vx.meshes.SPACE_FAMILIES])
def test_mean_strains_of_quadratic_displacements_are_their_strains_at_centroids(family):
    """The strains of u = (x^2 + x y, y^2 - x y), in space (x y, y z, z x), are linear."""
    mesh = {**vx.meshes.FAMILIES, **vx.meshes.SPACE_FAMILIES}[family](2)
    if family in vx.meshes.FAMILIES:
        (x, y), quadratic = mesh.centroids.T, lambda p: p * np.column_stack([p.sum(axis=1), p[:, 1] - p[:, 0]])
        exact = [2 * x + y, 2 * y - x, x - y]
    else:
        (x, y, z), quadratic = mesh.centroids.T, lambda p: p * p[:, [1, 2, 0]]
        exact = [y, z, x, x, y, z]
    np.testing.assert_allclose(mean_strains(Space(mesh), quadratic), np.column_stack(exact), atol=1e-13)
