"""Pi_K: the paper's three conditions, on edge data integrated by quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import small

from vemcvx.vem import Space
from vemcvx.vem.projection import area_gradients, boundary_weights

# Sums of a dozen products of numbers near one: a hundred roundings at most, amplified by perimeter^2 / area < 1e3
# on the cells below.
TOLERANCE = 1e-11


def groups(family):
    return Space(small(family, 4)).groups


def on_edges(corners, values):
    """Five Gauss points an edge: fields (n * 5, ...) linear on edges, normals times weight, weights."""
    s, weight = np.polynomial.legendre.leggauss(5)
    s, weight = 0.5 + 0.5 * s, 0.5 * weight
    after, chord = np.roll(values, -1, axis=0), np.roll(corners, -1, axis=0) - corners
    field = (1 - s)[None, :, None] * values[:, None] + s[None, :, None] * after[:, None]
    normal = np.column_stack([chord[:, 1], -chord[:, 0]])[:, None] * weight[:, None]
    length = np.linalg.norm(chord, axis=1)[:, None] * weight
    return field.reshape(-1, 2), normal.reshape(-1, 2), length.ravel()


def test_linear_fields_are_their_own_projection_and_the_second_is_the_first(family):
    slope = np.array([[0.3, -1.2], [0.7, 0.4]])
    for group in groups(family):
        x, Pi = group.corners, group.vertex_values()
        p = x @ slope.T + [2.0, -1.0]
        assert np.abs(Pi @ p - p).max() < TOLERANCE
        assert np.abs(Pi @ Pi - Pi).max() < TOLERANCE


def test_three_conditions(family):
    """Strain, rotation and boundary mean of Pi v are those of v, by Gauss's theorem on its edge values."""
    rng = np.random.default_rng(1)
    for group in groups(family):
        x = group.corners
        v = rng.standard_normal(x.shape)
        projected = group.vertex_values() @ v
        size = np.sqrt(area_gradients(x)[0])
        for corners, given, linear, h in zip(x, v, projected, size, strict=True):
            basis = np.column_stack([np.ones(len(corners)), corners / h])
            slope = np.linalg.lstsq(basis, linear, rcond=None)[0]
            assert np.abs(basis @ slope - linear).max() < TOLERANCE  # Pi v is linear
            field, normal, length = on_edges(corners, given)
            mean_gradient = field.T @ normal / h  # int_dK v (x) n ds / |K|, in units of 1 / h
            assert np.abs(slope[1:].T - mean_gradient).max() < TOLERANCE
            flat, _, _ = on_edges(corners, linear)
            assert np.abs(length @ flat - length @ field).max() < TOLERANCE * length.sum()


def test_weights_are_means_over_the_boundary():
    corners = np.array([[[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]]])
    assert boundary_weights(corners)[0] == pytest.approx([8 / 24, 7 / 24, 9 / 24], rel=1e-15)


def test_gradients_reproduce_area_and_sum_to_zero(family):
    for group in groups(family):
        areas, g = area_gradients(group.corners)
        assert np.abs(g.sum(axis=1)).max() < 1e-15 * np.abs(g).max() * g.shape[1]
        moments = np.einsum("cia,cib->cab", group.corners, g)
        assert np.abs(moments - areas[:, None, None] * np.eye(2)).max() < 1e-14 * np.abs(g).max()
