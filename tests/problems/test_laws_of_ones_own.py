"""Problems with a user's law of friction or of glue, against their closed forms."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from solids import SOLIDS, solid

import cohesive_interface as glued
import slip_weakening as weakening
import vemcvx as vx
from vemcvx.scene import pose_scene


def bound_errors(history, scene, rho, turns=3):
    """Return the largest errors of slips and of forces per length at nodes that the certificates allow.

    A turn multiplies errors of slip and of accumulated slip by at most (1 + rho) / (1 - rho).
    """
    run = history.trajectory
    total = ((1 + rho) / (1 - rho)) ** turns * (np.sqrt(2 * run.gap) + np.sqrt(2 * run.floor)).sum()
    system = pose_scene(scene, history.mesh).system
    felt = system.B @ np.linalg.solve(system.K.toarray(), system.B.T.toarray())
    stiff = np.sqrt(np.diag(np.linalg.inv(felt)).max())
    return np.sqrt(np.diag(felt).max()) * total, 2 * stiff * total / history.contact.lengths.min()


@pytest.mark.long
def test_slip_weakening_follows_its_closed_form(family):
    mesh, times = weakening.mesh(3, family), weakening.times(20)
    history = vx.simulate(weakening.scene(), mesh, times, solver=vx.Newton(1e-9))
    assert history.certificate_kind == "for the given friction"
    q, a = weakening.exact_solution(times)
    slip, force = bound_errors(history, weakening.scene(), rho=0.5)
    assert slip < 1e-3 * np.abs(a).max()
    assert np.abs(history.contact.slip[:, :, 0] - a[:, None]).max() < slip
    assert np.abs(-history.contact.traction[:, :, 0] - q[:, None]).max() < force
    path = np.append(0.0, np.abs(np.diff(a)).cumsum())
    assert np.abs(history.contact.accumulated_slip - path[:, None]).max() < slip
    # Friction weakens in both directions.
    bound = np.maximum(weakening.PEAK - weakening.FALL * path, weakening.RESIDUAL)
    assert np.abs(history.contact.bound - bound[:, None]).max() < weakening.FALL * slip + 1e-12
    assert (np.diff(bound[times > 1.5]) < 0).any()


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Newton(1e-8), vx.Clarabel(1e-6)], ids=["Newton", "Clarabel"])
def test_glue_that_softens_follows_its_closed_form(solver):
    mesh, times = glued.mesh(2, "hexagons"), glued.times(24)
    history = vx.simulate(glued.scene(), mesh, times, solver=solver)
    assert history.certificate_kind == "for the given friction"
    contact, (sigma, a) = history.contact, glued.exact_solution(times)
    apart = history.displacement[:, contact.partners, 1] - history.displacement[:, contact.nodes, 1]
    gap, force = bound_errors(history, glued.scene(), glued.COMPLIANCE * glued.STRENGTH / glued.WAY)
    assert gap < 1e-2 * a.max()
    assert np.abs(apart - a[:, None]).max() < gap
    assert np.abs(contact.pressure + sigma[:, None]).max() < force
    assert np.abs(contact.traction).max() < force
    assert sigma[np.searchsorted(times, 1.75)] < 0 < sigma.max()
    assert sigma[-1] == 0 < a[-1]


# In space slip is a vector: laws read the length of its path, and friction opposes the slip of the step.

PATH = np.array([(0, 0), (0.05, 0.02), (0.15, 0.05), (0.2, 0.2), (0.05, 0.25), (-0.15, 0.05), (0.0, -0.1)])


def solve_in_space(height, mu, law):
    """Return slips a, forces q and lengths of the path of slip of a block whose top moves along `PATH`, step by step.

    q = mu (U - a) / H has the direction of the trial force; in steps that slip by s, |trial| - mu s / H = g(A + s).
    """
    a, q, path, stiff = [np.zeros(2)], [np.zeros(2)], [0.0], mu / height
    for U in PATH[1:]:
        trial = stiff * (U - a[-1])
        size = np.linalg.norm(trial)
        slip = max(size - law.at(path[-1]), 0.0) / (stiff - law.fall)
        if law.peak - law.fall * (path[-1] + slip) < law.residual:
            slip = max(size - law.residual, 0.0) / stiff
        a.append(a[-1] + slip * trial / size)
        path.append(path[-1] + slip)
        q.append(stiff * (U - a[-1]))
    return np.array(a), np.array(q), np.array(path)


@dataclass(frozen=True)
class LinearWeakening:
    """g(A) = max(peak - fall A, residual); negative falls harden."""

    peak: float
    residual: float
    fall: float

    def at(self, path):
        return max(self.peak - self.fall * path, self.residual)


@dataclass(frozen=True)
class SlipFriction(vx.Effect):
    """Friction on the floor by the law `LinearWeakening`."""

    law: LinearWeakening

    def contribute(self, space):
        rows = space.part("bottom", "SlipFriction", contact=True).node_normals

        def weights(t, p, past, slip):
            return rows.lengths * np.maximum(self.law.peak - self.law.fall * (past + slip), self.law.residual)

        law = vx.effects.Law(weights, softening=max(self.law.fall, 0.0) * rows.lengths)
        friction = replace(vx.effects.Friction.from_rows(rows, "SlipFriction"), law=law)
        return vx.effects.Contribution(frictions=(friction,), surfaces=(vx.effects.ContactSurface.from_rows(rows),))

    def describe(self):
        return "SlipFriction: on bottom"


@pytest.mark.long
@pytest.mark.parametrize("fall", [6.25, 0.5, -2.0])
@pytest.mark.parametrize("name", SOLIDS)
def test_friction_that_weakens_or_hardens_in_space_follows_its_closed_form(name, fall):
    height, mu = 0.8, 10.0
    law = LinearWeakening(1.0, 0.4, fall)
    a, q, path = solve_in_space(height, mu, law)

    def side(axis, sign):
        return lambda x, t: [0.0, 0.0, sign * q[round(t), axis]]

    sides = ("left", 0, -1), ("right", 0, 1), ("front", 1, -1), ("back", 1, 1)
    scene = vx.Scene(
        vx.Elasticity(2 * mu, 0.0),
        vx.PrescribedDisplacement(lambda x, t: [*PATH[round(t)], 0.0], on="top"),
        *(vx.Traction(side(axis, sign), on=on) for on, axis, sign in sides),
        vx.BilateralContact(on="bottom"),
        SlipFriction(law),
    )
    mesh = solid(name, 2, ((0.0, 1.0), (0.0, 1.2), (0.0, height)))
    history = vx.simulate(scene, mesh, np.arange(float(len(PATH))), solver=vx.Newton(1e-9))
    assert history.certificate_kind == "for the given friction"
    contact = history.contact
    slip, force = bound_errors(history, scene, abs(fall) * height / mu, turns=len(PATH) - 1)
    assert slip < 1e-6 * path[-1]
    assert np.abs(contact.slip[:, :, :2] - a[:, None]).max() < slip
    assert np.abs(contact.accumulated_slip - path[:, None]).max() < slip
    assert np.abs(contact.traction[:, :, :2] + q[:, None]).max() < force
    # The path is longer than the distance of its ends; only the steepest law reaches its residual value.
    assert path[-1] > 2 * np.linalg.norm(a[-1])
    assert contact.bound[-1] == pytest.approx(law.at(path[-1]), abs=abs(fall) * slip + 1e-12)
    assert (law.at(path[-1]) == law.residual) == (fall == 6.25)
