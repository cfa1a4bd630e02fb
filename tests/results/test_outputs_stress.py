"""Principal, out-of-plane and von Mises stresses agree with closed forms."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scenes import few_families, mostly_long, small

import vemcvx as vx
from vemcvx.vem.tensors import equivalent, principal

YOUNG, POISSON = 200.0, 0.3
LAM, MU = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG / (2 * (1 + POISSON))
ALPHA, THETA = 1.2e-3, 50.0
STEEL = vx.Elasticity(YOUNG, POISSON)
# Moduli of wood, different along three axes.
E, NU, G = (12.0, 1.0, 0.6), (0.4, 0.5, 0.35), 0.9
ROUNDED = 1e-12
planes = pytest.mark.parametrize("plane", ["strain", "stress"])


def stretch(gradient, *effects):
    """Return the scene of a body whose boundary has the displacement t G x, with G = `gradient`."""
    gradient = np.array(gradient)
    return vx.Scene(*effects, vx.PrescribedDisplacement(lambda x, t: t * x @ gradient.T, on="boundary"))


def roll(*effects):
    """Return the scene of a body on rollers on the left and at the bottom."""
    return vx.Scene(*effects, vx.Symmetry(on=["left", "bottom"]))


def run(scene, family="voronoi"):
    return vx.simulate(scene, small(family, 4), [0.0, 1.0])


def test_invariants_agree_with_eigenvalues_and_the_deviator():
    rng = np.random.default_rng(3)
    stress, across = rng.normal(size=(50, 3)), rng.normal(size=50)
    (xx, yy, xy), zero = stress.T, np.zeros(50)
    tensor = np.stack([[xx, xy, zero], [xy, yy, zero], [zero, zero, across]]).transpose(2, 0, 1)
    assert principal(stress) == pytest.approx(np.linalg.eigvalsh(tensor[:, :2, :2])[:, ::-1], abs=ROUNDED)
    deviator = tensor - np.einsum("nii->n", tensor)[:, None, None] / 3 * np.eye(3)
    norm = np.sqrt(1.5 * np.einsum("nij,nij->n", deviator, deviator))
    assert equivalent(stress, across) == pytest.approx(norm, rel=ROUNDED)


@few_families
@planes
def test_uniaxial_stress_has_its_closed_form(family, plane):
    pull = 3.0
    traction = vx.Traction(lambda x, t: np.tile([pull * t, 0.0], (len(x), 1)), on="right")
    history = run(roll(vx.Elasticity(YOUNG, POISSON, plane=plane), traction), family)
    across = POISSON * pull if plane == "strain" else 0.0
    mises = pull * np.sqrt(1 - POISSON + POISSON**2) if plane == "strain" else pull
    assert history.out_of_plane_stress(-1) == pytest.approx(across, abs=ROUNDED * pull)
    assert history.von_mises(1) == pytest.approx(mises, rel=ROUNDED)
    assert np.abs(history.principal_stresses(-1) - [pull, 0.0]).max() <= ROUNDED * pull
    assert not history.von_mises(0).any()


@mostly_long("plane", ["strain", "stress"], 1)
def test_blocked_and_free_expansion_have_their_closed_forms(plane):
    """In plane strain, a body blocked on all sides has the hydrostatic stress -E alpha theta / (1 - 2 nu)."""
    heat = vx.ThermalStrain(ALPHA, lambda x, t: np.full(len(x), THETA * t))
    material = vx.Elasticity(YOUNG, POISSON, plane=plane)
    size = YOUNG * ALPHA * THETA
    blocked, free = run(stretch(np.zeros((2, 2)), material, heat)), run(roll(material, heat))
    if plane == "strain":
        assert blocked.out_of_plane_stress(-1) == pytest.approx(-size / (1 - 2 * POISSON), rel=ROUNDED)
        assert blocked.von_mises(-1) == pytest.approx(0.0, abs=ROUNDED * size)
        assert free.out_of_plane_stress(-1) == pytest.approx(-size, rel=ROUNDED)
        assert free.von_mises(-1) == pytest.approx(size, rel=ROUNDED)
    else:
        assert blocked.out_of_plane_prestress is None
        assert blocked.von_mises(-1) == pytest.approx(size / (1 - POISSON), rel=ROUNDED)
        assert free.von_mises(-1) == pytest.approx(0.0, abs=ROUNDED * size)


def test_wood_in_plane_strain_has_its_out_of_plane_stress():
    """The strain normal to the plane is zero."""
    heat = vx.ThermalStrain(1e-3, lambda x, t: np.full(len(x), 20.0 * t))
    strain, angle = [[0.01, 0.02], [-0.005, 0.03]], 0.7
    history = run(stretch(strain, vx.Orthotropic(E, NU, G, angle, plane="strain"), heat))
    axes = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    xx, yy, xy = history.stress(-1).T
    own = axes @ np.stack([[xx, xy], [xy, yy]]).transpose(2, 0, 1) @ axes.T
    wanted = E[2] * (NU[1] / E[0] * own[:, 0, 0] + NU[2] / E[1] * own[:, 1, 1] - 1e-3 * 20.0)
    assert history.out_of_plane_stress(-1) == pytest.approx(wanted, rel=1e-11)
    flat = run(stretch(strain, vx.Orthotropic(E[:2], NU[0], G, angle)))
    assert not flat.out_of_plane_stress(-1).any()


def test_stresses_that_are_not_known_are_refused():
    history = run(stretch(np.eye(2), STEEL))
    unknown = dataclasses.replace(history, out_of_plane=None)
    with pytest.raises(vx.SceneError, match="normal to the plane is unknown"):
        unknown.von_mises(-1)
    assert unknown.principal_stresses(-1).shape == (history.mesh.n_cells, 2)
