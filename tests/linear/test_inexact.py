"""Steps with the inexact solvers Iterative and PETSc."""

import numpy as np
import pytest
import scipy.sparse as sp
from blocks_in_space import assert_within_both_certificates
from installed import needs
from scenes import mostly_long, paper_scene, small

import vemcvx as vx
from vemcvx.linear import SuperLU
from vemcvx.scene import pose_scene

TIMES = np.linspace(0.0, 1.0, 5)
INEXACT = [pytest.param(vx.Iterative, marks=needs("pyamg")), pytest.param(vx.PETSc, marks=needs("petsc4py"))]
kinds = pytest.mark.parametrize("kind", INEXACT)


@kinds
@mostly_long("tolerance", [0.5, 1e-4, 1e-12], 1)
def test_energies_of_inexact_solves_are_upper_bounds(kind, tolerance):
    """The bound is less than 1.5 times the energy."""
    system = pose_scene(paper_scene(), small("voronoi", 14)).system
    exact, inexact = SuperLU().factorise(system.K), kind(tolerance).factorise(system.K, system.near_kernel)
    smooth, rough = system.force(1.0), np.random.default_rng(4).normal(size=system.n)
    for b in (smooth, rough, np.eye(1, system.n, 7)[0], system.K @ rough, smooth - system.K @ inexact.solve(smooth)):
        energy = exact.energy(b)
        assert energy <= inexact.energy(b) * (1 + 1e-9)
        assert inexact.energy(b) < 1.5 * energy
        assert energy == pytest.approx(float(b @ exact.solve(b)), rel=1e-12)


@kinds
@pytest.mark.long
@pytest.mark.parametrize("tolerance", [0.1, 1e-4, 1e-8])
def test_certificates_hold_whatever_the_tolerance(kind, tolerance):
    """1/2 |u - u*|^2 <= gap after one step, where u* is the answer with a direct factor."""
    scene, mesh = paper_scene(), small("voronoi", 12)
    exact = vx.simulate(scene, mesh, [0.0, 1.0])
    history = vx.simulate(scene, mesh, [0.0, 1.0], linear=kind(tolerance), check=False)
    apart = vx.measures.energy_distance(history, exact, kind="nodal").absolute
    bound = history.certificate[-1] * np.sqrt(2 * history.energy[-1])
    assert apart <= bound * (1 + 1e-6) + 1e-10 * np.sqrt(2 * exact.energy[-1])
    assert bound < 10 * tolerance * np.sqrt(2 * exact.energy[-1])


@kinds
def test_solves_that_do_not_converge_and_indefinite_matrices_are_refused(kind):
    system, name = pose_scene(paper_scene(), small("voronoi", 14)).system, kind.__name__
    with pytest.raises(vx.SceneError, match=rf"^{name}: 2 iterations left a residual of .*poisson < 0\.49.*SuperLU"):
        type(name, (kind,), {"max_iterations": 2})().factorise(system.K, system.near_kernel).solve(system.force(1.0))
    with pytest.raises(vx.SceneError, match="singular or indefinite"):
        kind().factorise(sp.csr_matrix([[1.0, 2.0], [2.0, 1.0]]))


@pytest.mark.long
@needs("pyamg")
def test_nearly_incompressible_bodies_are_refused():
    scene = vx.Scene(vx.Elasticity(1.0, 0.4999999), *(e for e in paper_scene() if not isinstance(e, vx.Elasticity)))
    words = r"^Iterative: the multigrid cycle approx.* too poorly .*poisson < 0\.49.*SuperLU"
    with pytest.raises(vx.SceneError, match=words):
        vx.simulate(scene, small("squares", 24), TIMES, linear=vx.Iterative())


def push(x, t):
    return t * np.column_stack([8 * (1.25 - x[:, 2]), np.full(len(x), 2.0), np.full(len(x), -4.0)])


HELD = vx.Elasticity(young=200.0, poisson=0.3), vx.Traction(push, on="left"), vx.TrescaFriction(bound=1.0, on="bottom")
SCENES = {
    "bilateral": (*HELD, vx.Clamp(on="right"), vx.BilateralContact(on="bottom")),
    "viscous": (*HELD, vx.Clamp(on="right"), vx.BilateralContact(on="bottom"), vx.Viscosity(0.1, 0.1)),
}


@kinds
@mostly_long("name", SCENES, "bilateral")
def test_states_and_forces_agree_with_those_of_a_direct_factor(kind, name):
    scene, mesh = vx.Scene(*SCENES[name]), vx.meshes.cubes(4)
    direct, iterative = (vx.simulate(scene, mesh, TIMES, linear=linear) for linear in (SuperLU(), kind()))
    posed = pose_scene(scene, mesh)
    one, two = direct.trajectory, iterative.trajectory
    assert_within_both_certificates(posed.system, one, two)
    claimed = sum(run.certificate_total + run.certificate_floor for run in (one, two)) * one.unit
    # |A e| <= |A|^(1/2) |e|_A, and |A| is at most the largest sum of |A_ij| in a row.
    stiff = abs(posed.A).sum(axis=1).max()
    if posed.viscosity is not None:
        stiff += abs(posed.viscosity).sum(axis=1).max() * 2 / np.diff(TIMES).min()
    rounding = 1e-13 * np.abs(abs(posed.A) @ np.abs(direct.displacement).max(axis=0).ravel()).max()
    apart = np.linalg.norm((iterative.forces - direct.forces).reshape(len(TIMES), -1), axis=1)
    assert (apart <= np.sqrt(stiff) * claimed + rounding).all()
    assert np.array_equal(iterative.contact.closed, direct.contact.closed)
