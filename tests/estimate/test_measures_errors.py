"""Errors against closed forms, observed orders, and the instants at which runs are compared."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import monotone, mostly_long, paper_load, paper_scene, small

import vemcvx as vx

LAM, MU = 1.5, 0.8
C = LAM + 2 * MU


def field(mesh, values):
    moduli = np.array([np.full(mesh.n_cells, LAM), np.full(mesh.n_cells, MU)])
    return vx.measures.Field(mesh, values, moduli, time=2.0)


def along(values):
    """Return a function from n to an array (m, n) with `values` in the first column."""
    return lambda width: np.column_stack([values, *[np.zeros(len(values))] * (width - 1)])


def test_polynomials_of_degree_five_are_integrated_exactly(family):
    """A body at rest has the squared errors C / 5 (strain x^2, modulus C) and 1 / 5 (displacement x^2)."""
    rest = small(family)
    rest = field(rest, np.zeros_like(rest.points))
    strain = vx.measures.energy_error(rest, lambda x, t: along(x[:, 0] ** 2)(3))
    assert strain.absolute == pytest.approx(np.sqrt(C / 5), rel=1e-12)
    assert strain.relative == pytest.approx(1.0, rel=1e-14)
    moved = vx.measures.l2_error(rest, lambda x, t: along(x[:, 0] ** 2)(2))
    assert moved.absolute == pytest.approx(np.sqrt(1 / 5), rel=1e-12)
    odd = vx.measures.l2_error(rest, lambda x, t: along(np.sqrt(x[:, 0] ** 2 * x[:, 1] ** 3))(2))
    assert odd.absolute == pytest.approx(np.sqrt(1 / 12), rel=1e-12)


def test_affine_fields_have_no_error_and_bodies_at_rest_have_the_whole_norm(family):
    mesh = small(family)
    G = np.array([[0.3, 0.2], [-0.1, 0.4]])
    linear = field(mesh, mesh.points @ G + 5.0)
    assert vx.measures.energy_error(linear, [0.3, 0.4, 0.1]).relative < 1e-13
    assert vx.measures.l2_error(linear, lambda x, t: x @ G + 2.5 * t).relative < 1e-14
    rest = field(mesh, np.zeros_like(mesh.points))
    assert vx.measures.energy_error(rest, [1.0, 0.0, 0.0]).cells == pytest.approx(np.sqrt(C * mesh.areas), rel=1e-12)
    assert vx.measures.energy_error(rest, [0.0, 0.0, 0.0]).relative == 0.0
    assert vx.measures.l2_error(field(mesh, 0.0 * mesh.points + 1.0), [0.0, 0.0]).relative == np.inf


@pytest.fixture(scope="module")
def pulled():
    return [vx.simulate(paper_scene(), vx.meshes.squares(4), np.linspace(0, 1, n + 1), store=2) for n in (4, 12)]


@pytest.mark.long
def test_runs_with_different_steps_are_compared_at_common_instants(pulled):
    coarse, fine = pulled
    same = vx.measures.energy_distance(coarse, fine, time=0.5)
    assert same.reference == vx.measures.energy_distance(coarse, fine, step=2, reference_step=6).reference
    assert same.relative < 1e-8
    assert vx.measures.energy_distance(coarse, fine, step=2).relative > 0.4
    with pytest.raises(vx.HistoryError, match=r"no step was stored at t = 0\.25; the nearest is step"):
        vx.measures.energy_distance(coarse, fine, time=0.25)
    with pytest.raises(vx.SceneError, match="step 3 was not stored"):
        vx.measures.energy_distance(coarse, fine, step=3)


def test_orders_of_powers_are_their_exponents():
    h = np.array([0.4, 0.2, 0.05])
    found = vx.measures.orders(h, 3 * h**1.5)
    assert found.successive == pytest.approx([1.5, 1.5])
    assert found.slope == pytest.approx(1.5)
    bent = vx.measures.orders([1, 2, 4], [1, 2, 8])
    assert bent.successive == pytest.approx([1.0, 2.0])
    assert bent.slope == pytest.approx(1.5)


@mostly_long("kind", ["exact", "projected"])
def test_nested_triangles_satisfy_galerkin_orthogonality(kind):
    """Nested spaces satisfy |u_fine - u_coarse|^2 = |u_fine|^2 - |u_coarse|^2."""
    scene = vx.Scene(
        vx.Elasticity(young=200.0, poisson=0.3), vx.Clamp(on="right"), vx.Traction(paper_load(monotone), on="left")
    )
    coarse, fine = (vx.simulate(scene, vx.meshes.triangles(n), [0.0, 1.0]) for n in (3, 12))
    apart = vx.measures.energy_distance(coarse, fine, kind=kind)
    assert apart.reference == pytest.approx(np.sqrt(2 * fine.energy[-1]), rel=1e-12)
    assert apart.absolute == pytest.approx(np.sqrt(2 * (fine.energy[-1] - coarse.energy[-1])), rel=1e-10)
