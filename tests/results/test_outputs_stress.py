"""Principal stresses, the stress across the plane and von Mises' stress, against closed forms and tensors in space."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scenes import few_families, mostly_long, small

import vemcvx as vx
from vemcvx.vem import equivalent, principal

YOUNG, POISSON = 200.0, 0.3
LAM, MU = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
ALPHA, THETA = 1.2e-3, 50.0
# Wood: three axes that differ.
E, NU, G = (12.0, 1.0, 0.6), (0.4, 0.5, 0.35), 0.9
ROUNDED = 1e-12


def held(gradient, *materials):
    """A body whose whole boundary follows u = gradient @ x."""
    gradient = np.array(gradient)
    return vx.Scene(*materials, vx.PrescribedDisplacement(lambda x, t: t * x @ gradient.T, on="boundary"))


def free(*parts):
    """A body on rollers on the left and at the bottom."""
    return vx.Scene(*parts, vx.Symmetry(on=["left", "bottom"]))


def last(scene, family="voronoi"):
    return vx.simulate(scene, small(family, 4), [0.0, 1.0])


def in_space(stress, across):
    """(n, 3, 3) tensors of stresses in the plane and across it."""
    xx, yy, xy = stress.T
    zero = np.zeros_like(xx)
    return np.stack([[xx, xy, zero], [xy, yy, zero], [zero, zero, across]]).transpose(2, 0, 1)


def test_invariants_of_tensors():
    """Eigenvalues, and sqrt(3/2 s : s) of the deviator s."""
    rng = np.random.default_rng(3)
    stress, across = rng.normal(size=(50, 3)), rng.normal(size=50)
    tensor = in_space(stress, across)
    assert principal(stress) == pytest.approx(np.linalg.eigvalsh(tensor[:, :2, :2])[:, ::-1], abs=ROUNDED)
    deviator = tensor - np.einsum("nii->n", tensor)[:, None, None] / 3 * np.eye(3)
    norm = np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator))
    assert equivalent(stress, across) == pytest.approx(norm, rel=ROUNDED)


@few_families
@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_uniaxial(family, plane):
    pull = 3.0
    traction = vx.Traction(lambda x, t: np.tile([pull * t, 0.0], (len(x), 1)), on="right")
    history = last(free(vx.Elasticity(YOUNG, POISSON, plane=plane), traction), family)
    across = POISSON * pull if plane == "strain" else 0.0
    mises = pull * np.sqrt(1 - POISSON + POISSON**2) if plane == "strain" else pull
    assert history.out_of_plane_stress(-1) == pytest.approx(across, abs=ROUNDED * pull)
    assert history.von_mises(1) == pytest.approx(mises, rel=ROUNDED)
    assert np.abs(history.principal_stresses(-1) - [pull, 0.0]).max() <= ROUNDED * pull
    assert not history.von_mises(0).any()


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_pure_shear(plane):
    history = last(held([[0.0, 0.02], [0.0, 0.0]], vx.Elasticity(YOUNG, POISSON, plane=plane)))
    shear = MU * 0.02
    assert history.von_mises(-1) == pytest.approx(np.sqrt(3) * shear, rel=ROUNDED)
    assert np.abs(history.principal_stresses(-1) - [shear, -shear]).max() <= ROUNDED * shear


@pytest.mark.parametrize("plane", ["strain", "stress"])
def test_equal_compression_in_the_plane(plane):
    """In plane strain 2 mu e is left of it, in plane stress all."""
    e = -0.01
    history = last(held([[e, 0.0], [0.0, e]], vx.Elasticity(YOUNG, POISSON, plane=plane)))
    flat = 2 * (LAM + MU) * e if plane == "strain" else YOUNG / (1 - POISSON) * e
    across = 2 * LAM * e if plane == "strain" else 0.0
    assert np.abs(history.principal_stresses(-1) - flat).max() <= ROUNDED * abs(flat)
    assert history.out_of_plane_stress(-1) == pytest.approx(across, rel=ROUNDED)
    assert history.von_mises(-1) == pytest.approx(abs(flat - across), rel=ROUNDED)


@mostly_long("plane", ["strain", "stress"], 1)
def test_blocked_and_free_expansion(plane):
    """Blocked on all sides the stress is hydrostatic, -E alpha theta / (1 - 2 nu), and von Mises' is none."""
    heat = vx.ThermalStrain(ALPHA, lambda x, t: np.full(len(x), THETA * t))
    material = vx.Elasticity(YOUNG, POISSON, plane=plane)
    size = YOUNG * ALPHA * THETA
    blocked = last(held(np.zeros((2, 2)), material, heat))
    free_body = last(free(material, heat))
    if plane == "strain":
        assert blocked.out_of_plane_stress(-1) == pytest.approx(-size / (1 - 2 * POISSON), rel=ROUNDED)
        assert blocked.von_mises(-1) == pytest.approx(0.0, abs=ROUNDED * size)
        assert free_body.out_of_plane_stress(-1) == pytest.approx(-size, rel=ROUNDED)
        assert free_body.von_mises(-1) == pytest.approx(size, rel=ROUNDED)
    else:
        assert blocked.out_of_plane_prestress is None
        assert blocked.von_mises(-1) == pytest.approx(size / (1 - POISSON), rel=ROUNDED)
        assert free_body.von_mises(-1) == pytest.approx(0.0, abs=ROUNDED * size)


@mostly_long("angle", [0.0, 0.7], 1)
def test_orthotropic_body_that_cannot_strain_across(angle):
    """e_33 = -nu13 / E1 s_11 - nu23 / E2 s_22 + s_33 / E3 + alpha theta = 0, in the axes of the material."""
    heat = vx.ThermalStrain(1e-3, lambda x, t: np.full(len(x), 20.0 * t))
    wood = vx.Orthotropic(E, NU, G, angle, plane="strain")
    history = last(held([[0.01, 0.02], [-0.005, 0.03]], wood, heat))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    xx, yy, xy = history.stress(-1).T
    own = turn @ np.stack([[xx, xy], [xy, yy]]).transpose(2, 0, 1) @ turn.T
    wanted = E[2] * (NU[1] / E[0] * own[:, 0, 0] + NU[2] / E[1] * own[:, 1, 1] - 1e-3 * 20.0)
    assert history.out_of_plane_stress(-1) == pytest.approx(wanted, rel=1e-11)
    flat = last(held([[0.01, 0.02], [-0.005, 0.03]], vx.Orthotropic(E[:2], NU[0], G, angle)))
    assert not flat.out_of_plane_stress(-1).any()


def test_materials_by_region_and_isotropic_ones_in_other_words():
    def two(right):
        scene = held([[0.01, 0.02], [0.0, -0.03]], vx.Elasticity(50.0, 0.2, on="left half"), right)
        mesh = small("squares", 4)
        left = (mesh.centroids[:, 0] < 0.5).astype(float)
        mesh = mesh.with_cell_data("left half", left).with_cell_data("right half", 1 - left)
        heat = vx.ThermalStrain(ALPHA, lambda x, t: THETA * t * x[:, 1])
        return vx.simulate(vx.Scene(*scene.effects, heat), mesh, [0.0, 1.0])

    isotropic = two(vx.Elasticity(YOUNG, POISSON, on="right half"))
    shear = YOUNG / (2 * (1 + POISSON))
    same = two(vx.Orthotropic([YOUNG] * 3, [POISSON] * 3, shear, 0.4, plane="strain", on="right half"))
    for name in ("out_of_plane_stress", "von_mises", "principal_stresses"):
        one, other = (getattr(history, name)(-1) for history in (isotropic, same))
        assert one == pytest.approx(other, abs=1e-11 * np.abs(one).max()), name


def test_prestress_counts_in_the_plane():
    history = last(held(np.zeros((2, 2)), vx.Elasticity(YOUNG, POISSON), vx.Prestress(lambda x, t: [4 * t, 0.0, 0.0])))
    assert not history.out_of_plane_stress(-1).any()
    assert history.von_mises(-1) == pytest.approx(4.0, rel=ROUNDED)


def test_errors_say_what_is_missing():
    history = last(held(np.eye(2), vx.Elasticity(YOUNG, POISSON)))
    with pytest.raises(vx.SceneError, match="step 7 was not stored"):
        history.von_mises(7)
    unknown = dataclasses.replace(history, out_of_plane=None)
    with pytest.raises(vx.SceneError, match=r"normal to the plane is unknown.*principal_stresses\(step\)"):
        unknown.von_mises(-1)
    assert unknown.principal_stresses(-1).shape == (history.mesh.n_cells, 2)
