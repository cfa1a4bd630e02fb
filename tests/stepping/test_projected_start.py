"""Runs that begin from the projection P^h u_0 of Feng, Han and Huang."""

import logging

import numpy as np
import pytest
from scenes import mostly_long, small

import manufactured_start_and_stop as moving
import vemcvx as vx
from vemcvx.scene import pose_scene
from vemcvx.vem.loads import mean_strains

STEEL = vx.Elasticity(young=200.0, poisson=0.3)
PLANE = ("squares", "voronoi", "hexagons", "nonconvex", "triangles")


def linear(x, t):
    """Return linear displacements that vanish for x = 0."""
    return 1e-3 * (1 + t) * np.column_stack([x[:, 0] * (k + 1.0) for k in range(x.shape[1])])


@mostly_long("family", [*PLANE, *vx.meshes.SPACE_FAMILIES], "voronoi", "hanging", "tetrahedra", "prisms")
def test_linear_displacements_are_kept(family):
    """If u_0 is linear and in equilibrium with the loads, P^h u_0 = u_0, and nothing moves."""
    mesh = {**vx.meshes.FAMILIES, **vx.meshes.SPACE_FAMILIES}[family](2)
    dim = mesh.points.shape[1]
    scene = vx.Scene(STEEL, vx.PrescribedDisplacement(lambda x, t: linear(x, 0.0), on="boundary"))
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial=vx.projected(linear))
    for n in (0, 1):
        np.testing.assert_allclose(history.displacement[n], linear(mesh.points, 0.0), atol=1e-15 * dim)


@pytest.mark.parametrize("effect", [vx.Viscosity(shear=1.0), vx.TrescaFriction(1e-3, on="bottom")])
def test_the_initial_state_is_the_elastic_projection(effect):
    """a^h(P^h u_0, v) = sum_K |K| C eps_K : eps(Pi v) with moduli C and the mean strains eps_K of u_0 in cells K."""
    mesh = small("voronoi", 4)

    def u_0(x, t):
        return 1e-3 * np.column_stack([1 + x[:, 0] * x[:, 1], x[:, 0] ** 2])

    springs, held = vx.ElasticFoundation(3.0, 2.0, on="bottom"), vx.PrescribedDisplacement(u_0, on="left")
    scene = vx.Scene(STEEL, effect, springs, held, vx.BodyForce((0.0, 1.0)))
    u = vx.simulate(scene, mesh, [0.0, 1.0], initial=vx.projected(u_0, settle=False)).displacement[0].ravel()
    posed = pose_scene(scene, mesh)
    nodal = u_0(mesh.points, 0.0).ravel()
    assert 0 < np.abs(u - nodal).max() < 0.05 * np.abs(nodal).max()
    residual = posed.A @ u - posed.springs @ nodal
    for k, v in enumerate(posed.supports.P.T.toarray()[::7]):
        stress = np.einsum("ij,cj->ci", C, mean_strains(posed.space, lambda x: u_0(x, 0.0)))
        work = np.sum(mesh.areas[:, None] * stress * vx.vem.strains(posed.space, v))
        assert residual @ v == pytest.approx(work, abs=1e-12 * np.abs(residual).max()), k


def test_the_first_step_settles_a_projection_that_did_not_settle(tmp_path, monkeypatch):
    """Step 1 leads from P^h u_0 to the settled state."""
    mesh, times, still = moving.mesh(4, "voronoi"), [0.0, 1e-9], vx.projected(moving.displacement, settle=False)
    settled = vx.simulate(moving.scene(), mesh, times[:1], initial=moving.initial)
    whole = vx.simulate(moving.scene(), mesh, times, initial=still)
    assert whole.certificate[0] > 1e-3
    assert whole.certificate[1] < 1e-6
    size = np.abs(settled.displacement).max()
    np.testing.assert_allclose(whole.displacement[1], settled.displacement[0], atol=1e-7 * size)

    with monkeypatch.context() as patched, pytest.raises(ZeroDivisionError):  # noqa: PT012
        patched.setattr("vemcvx.stepping.backward_euler.step", lambda *of_a_step: 1 / 0)
        vx.simulate(moving.scene(), mesh, times, initial=still, stream=tmp_path)
    again = vx.simulate(moving.scene(), mesh, times, initial=still, stream=tmp_path, resume=True)
    np.testing.assert_allclose(again.displacement, whole.displacement, atol=1e-7 * size)


LAM, MU = 200.0 * 0.3 / (1.3 * 0.4), 200.0 / 2.6
C = np.diag([2 * MU, 2 * MU, MU]) + LAM * np.outer([1, 1, 0], [1, 1, 0])


@mostly_long("family", PLANE[:4], "squares")
def test_errors_from_the_projection_are_of_order_one(family):
    """Theorem 3.10 of Feng, Han and Huang assumes the start P^h u_0. Here h = 1 / n and k = 1 / (n + 1)."""
    initial, errors = vx.projected(moving.displacement, settle=False), []
    for n in (8, 16):
        run = vx.simulate(moving.scene(), moving.mesh(n, family), moving.times(n + 1), initial=initial)
        measured = [vx.measures.energy_error(run, moving.strain, step=k) for k in range(n + 2)]
        errors.append(max(one.absolute for one in measured) / max(one.reference for one in measured))
    assert 0.9 < vx.measures.orders(1 / np.array([8, 16]), errors).slope < 1.1


@mostly_long("mesh", [vx.meshes.squares(3), vx.meshes.cubes(2)], "squares", ids=["squares", "cubes"])
@pytest.mark.parametrize("pressed", [-1.0, 1.0])
def test_a_body_without_loads_comes_to_rest(mesh, pressed, caplog):
    """The initial state is lifted off an obstacle, or pressed into the obstacle."""
    scene = vx.Scene(vx.Elasticity(10.0, 0.3), vx.Clamp(on="top"), vx.UnilateralContact(on="bottom"))

    with caplog.at_level(logging.WARNING, logger="vemcvx"):
        history = vx.simulate(
            scene,
            mesh,
            [0.0, 1.0, 2.0],
            initial=vx.projected(lambda x, t: -0.01 * pressed * (1.0 - x[:, -1:]) * np.eye(x.shape[1])[-1]),
        )
    # The remaining displacement is below the accuracy of 1e-8, relative to the initial displacement.
    assert np.abs(history.displacement).max() <= 1e-8 * 0.01
    assert "violates condition (2.1)" in caplog.text


@pytest.mark.long
def test_adaptive_runs_and_programs_accept_a_projected_start():
    adapted = vx.adapt(moving.scene(), moving.mesh(4, "squares"), [0.0, 0.5], 0.2, initial=moving.initial)
    assert vx.measures.energy_error(adapted.history, moving.strain, step=0).relative < 0.2
    mesh = moving.mesh(4, "squares")
    (program,) = vx.programs(moving.scene(), mesh, [0.0, 0.5], initial=moving.initial)
    run = vx.simulate(moving.scene(), mesh, [0.0, 0.5], initial=moving.initial)
    assert program.answer.d.shape == run.program(1).answer.d.shape
    np.testing.assert_allclose(program.answer.d, run.program(1).answer.d, rtol=1e-9, atol=1e-18)
