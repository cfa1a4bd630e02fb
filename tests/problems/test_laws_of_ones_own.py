"""The problems whose effects are laws of one's own, against their closed forms."""

from __future__ import annotations

import inspect
from dataclasses import dataclass, replace

import numpy as np
import pytest
from solids import SOLIDS, solid

import cohesive_interface as glued
import slip_weakening as weakening
import vemcvx as vx
from vemcvx.scene import pose_scene


def allowed(history, scene, rho, turns=3):
    """Largest errors of slips and of forces per length at nodes, to which the certificates let errors add up.

    An error of a slip, and of all slip before, is at most (1 + rho) / (1 - rho) times as large after a turn.
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
    slip, force = allowed(history, weakening.scene(), rho=0.5)
    assert slip < 1e-3 * np.abs(a).max()
    assert np.abs(history.contact.slip[:, :, 0] - a[:, None]).max() < slip
    assert np.abs(-history.contact.traction[:, :, 0] - q[:, None]).max() < force
    way = np.append(0.0, np.abs(np.diff(a)).cumsum())
    assert np.abs(history.contact.accumulated_slip - way[:, None]).max() < slip
    # It has weakened in both directions.
    bound = np.maximum(weakening.PEAK - weakening.FALL * way, weakening.RESIDUAL)
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
    gap, force = allowed(history, glued.scene(), glued.COMPLIANCE * glued.STRENGTH / glued.WAY)
    assert gap < 1e-2 * a.max()
    assert np.abs(apart - a[:, None]).max() < gap
    assert np.abs(contact.pressure + sigma[:, None]).max() < force
    assert np.abs(contact.traction).max() < force
    assert sigma[np.searchsorted(times, 1.75)] < 0 < sigma.max()
    assert sigma[-1] == 0 < a[-1]


# In space slip is a vector: laws read the length of its path, and friction acts against what it adds.

PATH = np.array([(0, 0), (0.05, 0.02), (0.15, 0.05), (0.2, 0.2), (0.05, 0.25), (-0.15, 0.05), (0.0, -0.1)])


def slips_in_space(height, mu, law):
    """Slips a, forces q and the length of the way of a block whose top is moved along `PATH`, step by step.

    q = mu (U - a) / H has the direction of the trial force, and where it slips |trial| - mu s / H = g(A + s).
    """
    a, q, way, stiff = [np.zeros(2)], [np.zeros(2)], [0.0], mu / height
    for U in PATH[1:]:
        trial = stiff * (U - a[-1])
        size = np.linalg.norm(trial)
        slip = max(size - law.at(way[-1]), 0.0) / (stiff - law.fall)
        if law.peak - law.fall * (way[-1] + slip) < law.residual:
            slip = max(size - law.residual, 0.0) / stiff
        a.append(a[-1] + slip * trial / size)
        way.append(way[-1] + slip)
        q.append(stiff * (U - a[-1]))
    return np.array(a), np.array(q), np.array(way)


@dataclass(frozen=True)
class Weakens:
    """g(A) = max(peak - fall A, residual); negative falls harden."""

    peak: float
    residual: float
    fall: float

    def at(self, way):
        return max(self.peak - self.fall * way, self.residual)


@dataclass(frozen=True)
class Slips(vx.Effect):
    """Friction on the floor by such a law."""

    law: Weakens

    def contribute(self, space):
        rows = space.part("bottom", "Slips", contact=True).node_normals

        def weights(t, p, past, slip):
            return rows.lengths * np.maximum(self.law.peak - self.law.fall * (past + slip), self.law.residual)

        told = vx.effects.Law(weights, softening=max(self.law.fall, 0.0) * rows.lengths)
        friction = replace(vx.effects.Friction.from_rows(rows, "Slips"), law=told)
        return vx.effects.Contribution(frictions=(friction,), surfaces=(vx.effects.ContactSurface.from_rows(rows),))

    def describe(self):
        return "Slips: on bottom"


@pytest.mark.long
@pytest.mark.parametrize("fall", [6.25, 0.5, -2.0])
@pytest.mark.parametrize("name", SOLIDS)
def test_friction_that_weakens_and_hardens_in_space_follows_its_closed_form(name, fall):
    height, mu = 0.8, 10.0
    law = Weakens(1.0, 0.4, fall)
    a, q, way = slips_in_space(height, mu, law)

    def side(axis, sign):
        return lambda x, t: [0.0, 0.0, sign * q[round(t), axis]]

    sides = ("left", 0, -1), ("right", 0, 1), ("front", 1, -1), ("back", 1, 1)
    scene = vx.Scene(
        vx.Elasticity(2 * mu, 0.0),
        vx.PrescribedDisplacement(lambda x, t: [*PATH[round(t)], 0.0], on="top"),
        *(vx.Traction(side(axis, sign), on=on) for on, axis, sign in sides),
        vx.BilateralContact(on="bottom"),
        Slips(law),
    )
    mesh = solid(name, 2, ((0.0, 1.0), (0.0, 1.2), (0.0, height)))
    history = vx.simulate(scene, mesh, np.arange(float(len(PATH))), solver=vx.Newton(1e-9))
    assert history.certificate_kind == "for the given friction"
    contact = history.contact
    slip, force = allowed(history, scene, abs(fall) * height / mu, turns=len(PATH) - 1)
    assert slip < 1e-6 * way[-1]
    assert np.abs(contact.slip[:, :, :2] - a[:, None]).max() < slip
    assert np.abs(contact.accumulated_slip - way[:, None]).max() < slip
    assert np.abs(contact.traction[:, :, :2] + q[:, None]).max() < force
    # The way is longer than the distance gone, and by then all is lost, or not.
    assert way[-1] > 2 * np.linalg.norm(a[-1])
    assert contact.bound[-1] == pytest.approx(law.at(way[-1]), abs=abs(fall) * slip + 1e-12)
    assert (law.at(way[-1]) == law.residual) == (fall == 6.25)


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Newton(1e-8), vx.Clarabel(1e-6)], ids=["Newton", "Clarabel"])
def test_glue_in_space_follows_its_closed_form(solver):
    """Cohesion across an interface of cubes and Voronoi cells is that of the plane strip, which cannot bulge."""
    F, (low, high), sides = vx.meshes.SPACE_FAMILIES, glued.HEIGHTS, ("left", "right", "front", "back")
    mesh = vx.meshes.bodies(
        {
            "lower": F["voronoi3"](2, ((0, 1), (0, 1), (0, low))),
            "upper": F["cubes"](2, ((0, 1), (0, 1), (low, low + high))),
        }
    )
    scene = vx.Scene(
        vx.Elasticity(glued.YOUNG[0], glued.POISSON, on="lower"),
        vx.Elasticity(glued.YOUNG[1], glued.POISSON, on="upper"),
        vx.Symmetry(on=["lower.bottom", *(f"{body}.{side}" for body in ("lower", "upper") for side in sides)]),
        vx.PrescribedDisplacement(lambda x, t: np.full(len(x), glued.top(t)), on="upper.top", direction=(0, 0, 1)),
        vx.UnilateralContact(on=glued.JOINT),
        glued.Glue(glued.STRENGTH, glued.WAY, on=glued.JOINT),
    )
    times = glued.times(24)
    history = vx.simulate(scene, mesh, times, solver=solver)
    assert history.certificate_kind == "for the given friction"
    contact, (sigma, a) = history.contact, glued.exact_solution(times)
    apart = history.displacement[:, contact.partners, 2] - history.displacement[:, contact.nodes, 2]
    assert np.abs(apart - a[:, None]).max() < 1e-8 * a.max()
    assert np.abs(contact.pressure + sigma[:, None]).max() < 1e-8
    assert np.abs(contact.traction).max() < 1e-8


@pytest.mark.parametrize("effect", [weakening.SlipWeakening, glued.Glue])
def test_such_an_effect_has_no_more_than_forty_lines(effect):
    assert inspect.getsource(effect).count("\n") <= 40
