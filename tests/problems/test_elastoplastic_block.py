"""Von Mises plasticity as second-order cones: uniform states on polygons agree with return mapping and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from certified_bounds import admissible, bounds, ledger_bound, ledger_defect
from scenes import any_family, small

import elastoplastic_block as lesson
import vemcvx as vx
from spring_slider_chain import play


def assert_closed_form(mesh, stress, solver):
    posed = lesson.block(mesh, stress)
    trajectory = vx.march(posed.system, np.arange(float(len(stress))), solver=solver)
    p, eps, back = lesson.exact_solution(stress)
    plastic, total = lesson.cell_strains(mesh, posed, trajectory)
    allowed = bounds(posed.system, trajectory)
    error = allowed.state[:, len(posed.free) :].reshape(plastic.shape)
    assert (np.abs(plastic - p[:, None]) <= error).all()
    lam = admissible(posed.system, trajectory)
    off = np.linalg.norm(lam - back[:, None] * mesh.areas[:, None], axis=2)
    assert (off <= allowed.multipliers).all()
    loss = lesson.RADIUS * np.append(0.0, np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1)))
    assert (np.abs(trajectory.dissipated - loss) <= allowed.dissipated).all()
    assert (np.abs(ledger_defect(posed.system, trajectory)) <= ledger_bound(posed.system, trajectory)).all()
    assert allowed.state.max() < 0.02 * np.abs(eps).max()
    return total, eps


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Newton(), vx.Clarabel()], ids=lambda solver: solver.name)
def test_a_spiral_of_stress_follows_the_return_mapping(solver):
    assert_closed_form(small("voronoi", 3), lesson.spiral()[::2], solver)


@any_family
def test_strains_are_uniform_on_every_family(family):
    total, eps = assert_closed_form(small(family, 2), lesson.spiral()[::4], vx.Newton())
    # Newton stops at 1e-8 of the energy norm. Few cells of similar size share this error, so strains are within 1e-6.
    assert np.abs(total - eps[:, None]).max() < 1e-6 * np.abs(eps).max()


@pytest.mark.long
def test_the_return_mapping_of_pure_shear_is_a_play():
    shear = np.array([0.0, 0.4, 0.9, 1.2, 0.6, 0.0, -0.3, -1.0, 0.2, 1.3])
    _, eps, _ = lesson.exact_solution(np.outer(shear, [0, 0, 1]))
    p = play(lesson.RADIUS, np.sqrt(2) * shear)[:, 0] / lesson.HARDENING
    assert np.abs(p).max() > 0
    assert eps[:, 2] == pytest.approx(shear / lesson.MU + np.sqrt(2) * p, rel=1e-12, abs=1e-15)
