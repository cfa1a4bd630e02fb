"""Ratios of the stabilisation S to the shear energy a_mu of a cell: closed forms, invariance, bounds on families."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import OF_TRIANGLES, small

import stabilisation_spectrum as lesson
import vemcvx as vx

CLOSE = 0.04
"""Relative tolerance of ratios. The energies come from linear finite elements, with errors up to .018."""


def make_rectangle(a, b):
    return np.array([(-a, -b), (a, -b), (a, b), (-a, b)], dtype=float)


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (2.0, 1.0), (5.0, 1.0), (1.0, 3.0)])
def test_hourglass_modes_of_rectangles(a, b):
    """The displacements (x y, 0) and (0, x y) have the ratios 6ab / (a^2 + 2b^2) and 6ab / (b^2 + 2a^2)."""
    exact = sorted([6 * a * b / (a * a + 2 * b * b), 6 * a * b / (b * b + 2 * a * a)])
    assert lesson.spectrum(make_rectangle(a, b))[:2] == pytest.approx(exact, rel=CLOSE)


def test_nu_changes_only_the_ratio_to_the_energy_with_dilatation():
    """S / a_mu is independent of nu. With the dilatation energy a_lambda, S / (a_mu + a_lambda) is O(1 / lambda)."""
    rows = [lesson.spectrum(lesson.hexagon(1), poisson) for poisson in (0.3, 0.499, 0.499999)]
    assert np.ptp([row[0] for row in rows]) == 0.0
    assert np.ptp([row[1] for row in rows]) == 0.0
    # lambda is a thousand times larger in the third row than in the second row.
    assert rows[1][2] / rows[2][2] == pytest.approx(1000, rel=0.02)


@pytest.mark.long
@pytest.mark.parametrize("family", [name for name in vx.meshes.FAMILIES if name not in OF_TRIANGLES])
def test_ratios_are_bounded_on_every_family(family):
    mesh = small(family, 4, seed=2)
    found = np.array([lesson.spectrum(mesh.points[cell]) for cell in mesh.cells if len(cell) > 3])
    assert found[:, 0].min() > 0.3
    assert found[:, 1].max() < 10


def test_short_edges_reduce_the_least_ratio_like_a_logarithm():
    """1 / (least ratio) grows by equal amounts per decade of the edge length. The greatest ratio is bounded."""
    ratios = [1e-2, 1e-3, 1e-4, 1e-5]
    found = np.array([lesson.spectrum(lesson.square_without_corner(ratio)) for ratio in ratios])
    growth = np.diff(1 / found[:, 0])
    assert growth == pytest.approx(growth.mean(), rel=0.15)
    assert found[:, 1].max() < 3


@pytest.mark.long
def test_the_chart_is_drawn(tmp_path):
    rows = lesson.chart()
    assert [name for name, *_ in rows if "aspect" in name][-1] == "aspect ratio 100, hexagon"
    lesson.draw(rows, tmp_path / "chart.png")
    assert (tmp_path / "chart.png").stat().st_size > 5000
