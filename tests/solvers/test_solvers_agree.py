"""Histories of three solvers agree within their certificates."""

from functools import cache

import numpy as np
import pytest
from scenes import cyclic, monotone, mostly_long, paper_scene, small

import vemcvx as vx
from vemcvx.scene import pose_scene

pytestmark = pytest.mark.arithmetic
SOLVERS = {"newton": vx.Newton(), "clarabel": vx.Clarabel(), "osqp": vx.OSQP()}
TIMES = np.linspace(0.0, 1.0, 13)


def energy_norms(history, difference):
    """Return |u|_a for each row of nodal differences."""
    A = pose_scene(history.scene, history.mesh).A
    flat = difference.reshape(len(difference), -1)
    return np.sqrt(np.maximum(np.einsum("ni,ni->n", flat, (A @ flat.T).T), 0.0))


def assert_within_certificates(one, two, worth=1e-5):
    """Check that two histories differ by at most their total certificates, which are at most `worth`."""
    distance = energy_norms(one, one.displacement - two.displacement)
    scale = np.maximum.accumulate(np.sqrt(2 * one.energy))
    claimed = one.certificate_total + two.certificate_total + one.certificate_floor + two.certificate_floor
    assert (distance <= claimed * scale * (1 + 1e-6)).all()
    assert claimed[-1] < worth


@cache
def run(course, solver):
    load = {"monotone": monotone, "cyclic": cyclic}[course]
    return vx.simulate(paper_scene(load), small("voronoi"), TIMES, solver=SOLVERS[solver])


@mostly_long("course", ["monotone", "cyclic"], "cyclic")
@pytest.mark.parametrize("pair", [("newton", "clarabel"), ("newton", "osqp"), ("clarabel", "osqp")])
def test_histories_of_three_solvers_agree_within_total_certificates(course, pair):
    one, other = (run(course, solver) for solver in pair)
    assert_within_certificates(one, other)
    if course == "monotone":
        assert 0 < one.contact.sticking[-1].sum() < len(one.contact.nodes)
