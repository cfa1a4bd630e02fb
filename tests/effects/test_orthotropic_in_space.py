"""Orthotropic bodies in space: closed forms and rotated axes."""

import numpy as np
from scenes import mostly_long
from solids import SOLIDS, solid

import vemcvx as vx

BOX = ((0, 1), (0, 1), (0, 1))
SIDES = ["left", "right", "front", "back", "bottom", "top"]
E, NU, G = (120.0, 60.0, 30.0), (0.3, 0.25, 0.35), (20.0, 15.0, 10.0)
ANGLE = 0.4
TURN = np.array([[np.cos(ANGLE), np.sin(ANGLE), 0.0], [-np.sin(ANGLE), np.cos(ANGLE), 0.0], [0.0, 0.0, 1.0]])
GRADIENT = np.array([[0.02, 0.04, -0.03], [0.01, -0.05, 0.02], [0.03, 0.01, -0.012]])


def compliance():
    """Return S with (e_11, e_22, e_33, 2 e_12, 2 e_23, 2 e_13) = S sigma in material axes."""
    S = np.diag([*(1 / np.array(E)), 1 / G[0], 1 / G[2], 1 / G[1]])
    for (i, j), nu in zip(((0, 1), (0, 2), (1, 2)), NU, strict=True):
        S[i, j] = S[j, i] = -nu / E[i]
    return S


def tensor(components):
    xx, yy, zz, xy, yz, xz = components
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def stretched(effect, mesh, **options):
    """Simulate a body whose sides have affine displacements."""
    moved = vx.PrescribedDisplacement(lambda x, t: t * x @ GRADIENT.T, on=SIDES)
    return vx.simulate(vx.Scene(effect, moved), mesh, [0.0, 1.0], **options)


@mostly_long("name", SOLIDS, "hanging faces")
def test_affine_displacements_have_the_stress_of_hookes_law(name):
    """With the rotation R to material axes, sigma = R' sigma_m R with sigma_m = S^-1 e_m and e_m = R e R'."""
    history = stretched(vx.Orthotropic(E, NU, G, angle=ANGLE), solid(name, 2, BOX))
    strain = TURN @ (0.5 * (GRADIENT + GRADIENT.T)) @ TURN.T
    inside = np.linalg.solve(compliance(), [*np.diag(strain), *(2 * strain[[0, 1, 0], [1, 2, 2]])])
    stress = TURN.T @ tensor(inside) @ TURN
    for row in history.stress(-1):
        np.testing.assert_allclose(tensor(row), stress, atol=1e-10)
    assert history.von_mises(-1).shape == (history.mesh.n_cells,)
