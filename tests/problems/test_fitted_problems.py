"""The problem file whose parameters are fitted to measurements: a friction bound along a joint."""

import numpy as np

import friction_along_a_joint as joint
import vemcvx as vx


def test_the_fit_finds_the_bound_where_the_joint_slips_and_says_where_it_does_not():
    """The errors in the slipped part are at most three standard errors plus the bias of the regularisation.

    The bias is at most .25 (pi / 8)^2 = .039, the second difference of the friction bound at three neighbouring knots.
    """
    history = vx.simulate(joint.scene(), joint.mesh(4), joint.times(8))
    found = joint.find_bounds(history)
    slipped = history.contact.points[history.contact.accumulated_slip[-1] > 0.0, 0].min() + 2.0 < joint.KNOTS
    off = np.abs(found.theta - joint.TRUE)
    assert slipped.sum() > 10
    assert (off <= 3.0 * found.errors + 0.039)[slipped].all()
    assert found.errors[slipped].max() < 0.2
    assert (found.errors[joint.KNOTS < 8.0] > 0.4).all()
