"""Von Mises plasticity in second-order cones: uniform states on polygons, by return mapping and in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from certified_bounds import admissible, bounds, ledger_bound, ledger_defect
from scenes import any_family, small

import vemcvx as vx

PROBLEMS = Path(__file__).parents[2] / "problems"

import elastoplastic_block as lesson  # noqa: E402
from spring_slider_chain import play  # noqa: E402

SHEAR = np.array([0.0, 0.4, 0.9, 1.2, 0.6, 0.0, -0.3, -1.0, 0.2, 1.3])


def against_closed_form(mesh, stress, solver):
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
def test_the_spiral_is_a_return_mapping(solver):
    against_closed_form(small("voronoi", 3), lesson.spiral()[::2], solver)


@any_family
def test_uniform_on_every_family(family):
    total, eps = against_closed_form(small(family, 2), lesson.spiral()[::4], vx.Newton())
    # Newton stops within 1e-8 of the energy norm, cells are few and of similar size.
    assert np.abs(total - eps[:, None]).max() < 1e-6 * np.abs(eps).max()


@pytest.mark.long
def test_shear_alone_is_a_play():
    stress = np.outer(SHEAR, [0, 0, 1])
    total, _ = against_closed_form(small("voronoi", 3), stress, vx.Newton())
    p = play(lesson.RADIUS, np.sqrt(2) * SHEAR)[:, 0] / lesson.HARDENING
    gamma = SHEAR / lesson.MU + np.sqrt(2) * p
    assert np.abs(p).max() > 0
    assert np.abs(total[:, :, 2] - gamma[:, None]).max() < 1e-6 * np.abs(gamma).max()


def test_a_ball_is_no_box():
    system = lesson.block(vx.meshes.squares(2), lesson.spiral()).system
    with pytest.raises(vx.NotAccepted, match="second-order cones"):
        vx.march(system, [0.0, 1.0], solver=vx.OSQP())


def test_the_stored_energy_is_that_of_the_formula():
    """1/2 (eps - P) : C (eps - P) + H/2 |P|^2 of a uniform state, out-of-plane part included."""
    mesh = small("voronoi", 3)
    posed = lesson.block(mesh, lesson.spiral())
    # Zero at the lower left corner, and across at the lower right.
    G, p = np.array([[0.01, 0.05], [0.0, 0.02]]), np.array([0.004, -0.007, 0.011])
    u = (mesh.points @ G.T).ravel()
    y = np.concatenate([u[posed.free], np.tile(p, mesh.n_cells)])
    eps, N = np.zeros((3, 3)), _basis()
    eps[:2, :2] = 0.5 * (G + G.T)
    e = eps - np.einsum("k,kij->ij", p, N)
    stored = lesson.MU * np.sum(e * e) + 0.5 * lesson.LAM * np.trace(e) ** 2 + 0.5 * lesson.HARDENING * p @ p
    assert 0.5 * y @ (posed.system.K @ y) == pytest.approx(stored, rel=1e-12)


def _basis():
    N = np.zeros((3, 3, 3))
    N[0], N[1] = np.diag([1, -1, 0]) / np.sqrt(2), np.diag([1, 1, -2]) / np.sqrt(6)
    N[2, 0, 1] = N[2, 1, 0] = 1 / np.sqrt(2)
    return N
