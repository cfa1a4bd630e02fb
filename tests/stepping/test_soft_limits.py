"""Bodies on soft contact and weak springs, with a nearly singular stiffness matrix."""

import numpy as np
import pytest
from exact_steps import Steps
from installed import needs
from scenes import mostly_long, small

import vemcvx as vx
from vemcvx.scene import pose_scene

EPS = float(np.finfo(float).eps)
LINEAR = [vx.SuperLU(), pytest.param(vx.Pardiso(), marks=needs("pymklpardiso"))]
FRICTION = {
    "no friction": (),
    "Tresca": (vx.TrescaFriction(0.3, on="bottom"),),
    "Coulomb": (vx.CoulombFriction(0.06, on="bottom"),),
}
STIFFNESS = 400.0


def squares(n):
    return vx.meshes.squares(n, box=((0, 2), (0, 1)))


def pressed(k, *effects, push=0.05):
    """Return the scene of a block on soft ground, with springs of stiffness k on the left side."""

    def traction(x, t):
        return np.column_stack([np.full(len(x), push * t), -0.5 * (1 + t) * (1 + 0.3 * x[:, 0])])

    return vx.Scene(
        vx.Elasticity(100.0, 0.3),
        vx.ElasticFoundation(k, k, on="left"),
        vx.NormalCompliance(STIFFNESS, on="bottom"),
        vx.Traction(traction, on="top"),
        *effects,
    )


def settled(scene, mesh, **options):
    return vx.simulate(scene, mesh, [0.0, 1.0], initial="settled", **options)


@mostly_long("linear", LINEAR, ids=str)
@mostly_long("k", [1e-2, 1e-4, 1e-6], 2)
def test_soft_contact_and_weak_springs_balance_the_load(k, linear):
    """With springs of stiffness 1e-8 E, rounding once caused an error of 40 times the energy norm of the solution."""
    scene, mesh = pressed(k, push=0.0), squares(8)
    history = settled(scene, mesh, linear=linear, condense=False)
    assert history.certificate.max() <= 1e-8
    left = np.unique(mesh.boundaries["left"])
    # The trapezoidal rule integrates the spring force, which is k times the displacement.
    share = np.ones(len(left))
    share[[np.argmin(mesh.points[left, 1]), np.argmax(mesh.points[left, 1])]] = 0.5
    spring = -k * float(share @ history.displacement[1, left, 1]) / (len(left) - 1)
    carried = float(history.contact.pressure[1] @ history.contact.lengths) + spring
    load = 1.0 * 2 * 1.3
    assert abs(carried - load) <= 64 * EPS * load


@pytest.mark.long
@pytest.mark.parametrize("kind", FRICTION)
@pytest.mark.parametrize("k", [1e-4, 1e-6])
@pytest.mark.parametrize("condense", [True, False])
def test_certificates_bound_the_distance_to_exact_steps(k, kind, condense):
    """Exact steps are computed with 512 bits."""
    system = pose_scene(pressed(k, *FRICTION[kind]), small("voronoi", 3, box=((0, 2), (0, 1)))).system
    run = vx.march(system, [0.0, 1.0], initial="settled", condense=condense, check=False)
    y, lam, p = run.state, run.multipliers, run.pressures
    weights = None if system.norms is None else run.weights[1]
    steps = Steps(system)
    exact = steps.step(y[0], 0.0, 1.0, (y[1] - y[0], lam[1].ravel(), p[1]), weights=weights)
    off = exact.distance(steps.scaled(y[0], y[1], exact.unit))
    assert off <= (run.certificate[1] + run.certificate_floor[1]) * run.unit[1]
    assert condense or k < 1e-5 or run.certificate.max() <= 1e-8


def test_a_given_start_with_dashpots_has_the_pressure_of_its_depth():
    """At x, the body compresses the ground by 0.01 x. The stiffness of the ground is 100, so the pressure is x."""
    mesh = vx.meshes.squares(2)
    creep = vx.Elasticity(20.0, 0.0), vx.Viscosity(5.0, 0.0), vx.Clamp(on="left")
    down = np.column_stack([0.0 * mesh.points[:, 0], -0.01 * mesh.points[:, 0]])
    history = vx.simulate(vx.Scene(*creep, vx.NormalCompliance(100.0, on="bottom")), mesh, [0.0, 1.0], initial=down)
    np.testing.assert_allclose(history.contact.pressure[0], history.contact.points[:, 0], atol=1e-14)
