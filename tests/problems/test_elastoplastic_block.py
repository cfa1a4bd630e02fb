"""Von Mises plasticity as second-order cones: uniform states on polygons agree with return mapping and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import any_family, small

import elastoplastic_block as lesson
import vemcvx as vx
from spring_slider_chain import play


@any_family
def test_a_spiral_of_stress_follows_the_return_mapping(family):
    mesh, stress = small(family, 2), lesson.spiral()[::4]
    posed = lesson.block(mesh, stress)
    trajectory = vx.march(posed.system, np.arange(float(len(stress))), solver=vx.Newton(1e-12))
    p, eps, back = lesson.exact_solution(stress)
    plastic, total = lesson.cell_strains(mesh, posed, trajectory)
    assert np.abs(plastic - p[:, None]).max() < 1e-9 * np.abs(p).max()
    assert np.abs(total - eps[:, None]).max() < 1e-9 * np.abs(eps).max()
    exact = back[:, None] * mesh.areas[:, None]
    assert np.abs(trajectory.multipliers - exact).max() < 1e-9 * np.abs(exact).max()
    loss = lesson.RADIUS * np.append(0.0, np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1)))
    assert trajectory.dissipated == pytest.approx(loss, rel=1e-9)


@pytest.mark.long
def test_the_return_mapping_of_pure_shear_is_a_play():
    shear = np.array([0.0, 0.4, 0.9, 1.2, 0.6, 0.0, -0.3, -1.0, 0.2, 1.3])
    _, eps, _ = lesson.exact_solution(np.outer(shear, [0, 0, 1]))
    p = play(lesson.RADIUS, np.sqrt(2) * shear)[:, 0] / lesson.HARDENING
    assert np.abs(p).max() > 0
    assert eps[:, 2] == pytest.approx(shear / lesson.MU + np.sqrt(2) * p, rel=1e-12, abs=1e-15)
