"""Solvers of different kinds, cross-validated: each within what its certificate claims, on every family."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scenes import cyclic, few_families, monotone, paper_scene, small

import vemcvx as vx

pytestmark = pytest.mark.arithmetic

COURSES = {"monotone": monotone, "cyclic": cyclic}
SOLVERS = {"newton": vx.Newton(), "clarabel": vx.Clarabel(), "osqp": vx.OSQP()}
TIMES = np.linspace(0.0, 1.0, 13)


@cache
def run(family, course, solver):
    return vx.simulate(paper_scene(COURSES[course]), small(family), TIMES, solver=SOLVERS[solver])


def energy_norms(history, difference):
    """|u|_a of rows of nodal differences, with the matrix of the scene itself."""
    A = vx.simulate.__globals__["pose_scene"](history.scene, history.mesh).A
    flat = difference.reshape(len(difference), -1)
    return np.sqrt(np.maximum(np.einsum("ni,ni->n", flat, (A @ flat.T).T), 0.0))


@few_families
@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("pair", [("newton", "clarabel"), ("newton", "osqp"), ("clarabel", "osqp")])
def test_histories_agree_within_their_accumulated_certificates(family, course, pair):
    one, two = (run(family, course, solver) for solver in pair)
    distance = energy_norms(one, one.displacement - two.displacement)
    scale = np.maximum.accumulate(np.sqrt(2 * one.energy))
    claimed = one.certificate_total + two.certificate_total + one.certificate_floor + two.certificate_floor
    assert (distance <= claimed * scale * (1 + 1e-6)).all()
    # The claim is worth something: a thousandth of a per cent of the answer.
    assert claimed[-1] < 1e-5


@pytest.mark.long
@few_families
@pytest.mark.parametrize("course", COURSES)
def test_steps_agree_from_the_same_state(family, course):
    reference = run(family, course, "newton")
    for n in (1, 5, 9, 12):
        start = reference.displacement[n - 1]
        answers = [
            vx.simulate(reference.scene, reference.mesh, TIMES[n - 1 : n + 1], solver=s, initial=start)
            for s in SOLVERS.values()
        ]
        norms = [np.sqrt(2 * a.energy[-1]) for a in answers]
        for i, one in enumerate(answers):
            for j, two in enumerate(answers[:i]):
                distance = energy_norms(one, (one.displacement - two.displacement)[-1:])[0]
                gaps = np.sqrt(2 * one.trajectory.gap[-1]) + np.sqrt(2 * two.trajectory.gap[-1])
                floors = np.sqrt(2 * one.trajectory.floor[-1]) + np.sqrt(2 * two.trajectory.floor[-1])
                assert distance <= gaps + floors
                assert gaps < 1e-5 * max(norms[i], norms[j])


@pytest.mark.long
@few_families
def test_the_certificate_bounds_the_true_error(family):
    """A poor answer, certified as it is, against one that is converged to the rounding floor."""
    scene, mesh = paper_scene(), small(family)
    truth = vx.simulate(scene, mesh, [0.0, 1.0], solver=vx.Newton(accuracy=1e-12), check=False)
    assert truth.certificate[-1] < 1e-10
    for loose in (1e-2, 1e-4, 1e-6):
        options = {"tol_gap_abs": loose, "tol_gap_rel": loose, "tol_feas": loose}
        poor = vx.simulate(scene, mesh, [0.0, 1.0], solver=vx.Clarabel(accuracy=1e-12, options=options), check=False)
        error = energy_norms(truth, (truth.displacement - poor.displacement)[-1:])[0]
        certified = np.sqrt(2 * poor.trajectory.gap[-1]) + np.sqrt(2 * poor.trajectory.floor[-1])
        assert error <= certified
        assert certified > 1e-9 * np.sqrt(2 * truth.energy[-1])


@few_families
def test_both_stick_and_slip_occur_and_the_bound_matters(family):
    history = run(family, "monotone", "newton")
    assert 0 < history.contact.sticking[-1].sum() < len(history.contact.nodes)
    other = vx.simulate(paper_scene(bound=2.0), history.mesh, TIMES, solver=vx.Newton())
    change = energy_norms(history, (other.displacement - history.displacement)[-1:])[0]
    assert change > 1e-2 * np.sqrt(2 * history.energy[-1])


def test_the_weight_law_holds(family):
    """(3.6): |traction| <= g, below it no slip, at it slip against it."""
    history = run(family, "cyclic", "newton")
    contact = history.contact
    size = np.linalg.norm(contact.traction, axis=2)
    assert (size <= contact.bound * (1 + 1e-12)).all()
    steps = np.diff(contact.slip, axis=0)
    length = np.linalg.norm(steps, axis=2)
    moves = length > 1e-12 * np.abs(contact.slip).max()
    assert moves.any()
    assert (size[1:][moves] >= contact.bound[1:][moves] * (1 - 1e-12)).all()
    against = np.einsum("smd,smd->sm", steps, contact.traction[1:])
    assert np.allclose(against[moves], -(length * size[1:])[moves], rtol=1e-10, atol=0)
    assert (contact.sticking[1:] == ~moves).all()


@pytest.mark.long
def test_full_and_condensed_programs_agree():
    mesh, scene = small("voronoi", 5), paper_scene(cyclic)
    for solver in (vx.Newton(), vx.Clarabel(), vx.OSQP()):
        condensed = vx.simulate(scene, mesh, TIMES[:6], solver=solver)
        full = vx.simulate(scene, mesh, TIMES[:6], solver=solver, condense=False)
        distance = energy_norms(condensed, condensed.displacement - full.displacement)
        scale = np.maximum.accumulate(np.sqrt(2 * condensed.energy))
        claimed = condensed.certificate_total + full.certificate_total + 2 * condensed.certificate_floor
        assert (distance <= claimed * scale * (1 + 1e-6)).all()
