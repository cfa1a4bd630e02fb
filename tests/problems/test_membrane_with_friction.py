"""The scalar membrane: exact where u is linear, of first order elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import few_families

import membrane_with_friction as lesson
import vemcvx as vx
from spring_slider_chain import play

pytestmark = pytest.mark.arithmetic

BOX = ((0.0, lesson.LENGTH), (0.0, lesson.HEIGHT))
TIMES = np.arange(float(len(lesson.EDGE_PULL)))


@few_families
def test_stick_slip_and_reversal_are_exact_on_every_mesh(family):
    mesh = vx.meshes.FAMILIES[family](4, box=BOX)
    posed = lesson.pose_strip(mesh, lesson.EDGE_PULL)
    trajectory = vx.march(posed.system, TIMES, solver=vx.Newton(1e-12))
    a, friction = lesson.solve_strip_exactly(lesson.EDGE_PULL)
    u = a[:, None] * (1 - mesh.points[posed.free, 1] / lesson.HEIGHT)
    assert np.abs(trajectory.state - u).max() < 1e-10 * np.abs(u).max()
    lam = trajectory.multipliers[:, :, 0]
    assert np.abs(lam - friction[:, None] * posed.measures).max() < 1e-10 * np.abs(lam).max()
    loss = lesson.BOUND * lesson.LENGTH * np.append(0.0, np.cumsum(np.abs(np.diff(a))))
    energy = 0.5 * a**2 * lesson.LENGTH / lesson.HEIGHT
    assert trajectory.dissipated == pytest.approx(loss, rel=1e-10)
    assert trajectory.energy == pytest.approx(energy, rel=1e-10)
    slips = np.append(False, np.diff(a) != 0)
    assert 0 < slips.sum() < len(slips) - 1
    assert (trajectory.sticking == ~slips[:, None]).all()
    closed = loss[-1] - loss[np.argmax(lesson.EDGE_PULL)]
    assert closed == pytest.approx(4 * lesson.BOUND * lesson.LENGTH * lesson.HEIGHT * (lesson.PEAK - lesson.BOUND))


def test_the_stiffness_reproduces_linear_functions(family):
    """For u = x, K u is the flux through the boundary, and u'Ku is the area."""
    mesh = vx.meshes.FAMILIES[family](4, box=BOX)
    K = lesson.scalar_stiffness(mesh)
    area, x = lesson.LENGTH * lesson.HEIGHT, mesh.points[:, 0]
    flux = lesson.node_lengths(mesh, "right") - lesson.node_lengths(mesh, "left")
    assert np.abs(K @ x - flux).max() < 1e-13
    assert x @ K @ x == pytest.approx(area, rel=1e-13)
    assert lesson.node_areas(mesh).sum() == pytest.approx(area, rel=1e-13)
    eigenvalues = np.linalg.eigvalsh(K.toarray())
    assert eigenvalues[0] == pytest.approx(0.0, abs=1e-12)
    assert eigenvalues[1] > 1e-3


def test_the_closed_form_on_a_rough_table_is_an_integral_of_play_operators():
    """A closed loop between the pulls q and q + D dissipates HEIGHT D^3 / (12 BOUND)."""
    x = np.linspace(0, lesson.LENGTH, 2001)
    pull = lesson.course(lesson.TURNS, 0.25)
    u, _ = lesson.solve_table_exactly(x)
    T = play(lesson.BOUND * x, pull)[lesson.turning_instants(pull, lesson.TURNS)]
    middle = 0.5 * (T[:, 1:] + T[:, :-1])
    integral = np.cumsum(middle[:, ::-1], axis=1)[:, ::-1] * (x[1] - x[0])
    # At the two jumps of the slope of T, the trapezoidal rule has errors of (jump) * (step)^2 / 8.
    assert np.abs(u[:, :-1] - integral).max() < 2 * 2 * lesson.BOUND * (x[1] - x[0]) ** 2 / 8
    lost = lesson.table_dissipation((0, 1.5, -1.5, 1.5))
    assert lost[-1] - lost[1] == pytest.approx(lesson.HEIGHT * 3**3 / (12 * lesson.BOUND), rel=1e-14)


@pytest.mark.long
def test_energies_and_slip_zones_on_the_table_have_errors_of_first_order():
    errors, sizes = [], []
    for n in (4, 8, 16):
        mesh = vx.meshes.voronoi(n, BOX)
        posed, trajectory, at = lesson.solve_on_table(mesh)
        errors.append(lesson.energy_error(posed, trajectory, at, mesh.points)[1:].max())
        sizes.append(mesh.h)
        _, friction = lesson.solve_table_exactly(mesh.points[posed.rough, 0])
        lam = trajectory.multipliers[at][:, :, 0]
        assert (np.abs(lam) <= lesson.BOUND * posed.measures * (1 + 1e-12)).all()
        # Exact friction jumps at the ends of two zones. Near the jumps computed friction is wrong.
        misplaced = np.abs(lam - friction * posed.measures).sum(axis=1)
        assert (misplaced[1:] <= 3 * lesson.BOUND * lesson.HEIGHT * mesh.h).all()
        lost = lesson.table_dissipation()
        assert np.abs(trajectory.dissipated[at] - lost).max() < lost[-1] * mesh.h**2
    rates = np.diff(np.log(errors)) / np.diff(np.log(sizes))
    assert rates[-1] > 0.9
    assert np.log(errors[-1] / errors[0]) / np.log(sizes[-1] / sizes[0]) > 1.0
