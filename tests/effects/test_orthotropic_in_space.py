"""Orthotropic bodies in space: closed forms, rotated axes, and isotropic bodies as a special case."""

import numpy as np
from scenes import mostly_long
from scipy.spatial.transform import Rotation
from solids import SOLIDS, solid

import vemcvx as vx
from vemcvx.vem import Space, strains
from vemcvx.vem.tensors import elastic_matrix

BOX = ((0, 1), (0, 1), (0, 1))
SIDES = ["left", "right", "front", "back", "bottom", "top"]
E, NU, G = (120.0, 60.0, 30.0), (0.3, 0.25, 0.35), (20.0, 15.0, 10.0)
TURN = Rotation.from_euler("zyx", [0.4, -0.7, 1.1]).as_matrix()
GRADIENT = np.array([[0.02, 0.04, -0.03], [0.01, -0.05, 0.02], [0.03, 0.01, -0.012]])


def compliance():
    """Return S with (e_11, e_22, e_33, 2 e_12, 2 e_23, 2 e_13) = S sigma in material axes."""
    S = np.diag([*(1 / np.array(E)), 1 / G[0], 1 / G[2], 1 / G[1]])
    for (i, j), nu in zip(((0, 1), (0, 2), (1, 2)), NU, strict=True):
        S[i, j] = S[j, i] = -nu / E[i]
    return S


def tensor(components, strain=False):
    xx, yy, zz, xy, yz, xz = components
    across = 0.5 if strain else 1.0
    xy, yz, xz = across * xy, across * yz, across * xz
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def stretched(effect, mesh, **options):
    """Simulate a body whose sides have affine displacements."""
    moved = vx.PrescribedDisplacement(lambda x, t: t * x @ GRADIENT.T, on=SIDES)
    return vx.simulate(vx.Scene(effect, moved), mesh, [0.0, 1.0], **options)


@mostly_long("name", SOLIDS, "hanging faces")
def test_affine_displacements_have_the_stress_of_hookes_law(name):
    """In rotated axes, sigma = R' sigma_m R with sigma_m = S^-1 e_m and e_m = R e R'."""
    history = stretched(vx.Orthotropic(E, NU, G, axes=(TURN[0], 3.0 * TURN[1] + 2.0 * TURN[0])), solid(name, 2, BOX))
    strain = TURN @ (0.5 * (GRADIENT + GRADIENT.T)) @ TURN.T
    inside = np.linalg.solve(compliance(), [*np.diag(strain), *(2 * strain[[0, 1, 0], [1, 2, 2]])])
    stress = TURN.T @ tensor(inside) @ TURN
    for row in history.stress(-1):
        np.testing.assert_allclose(tensor(row), stress, atol=1e-10)
    assert history.von_mises(-1).shape == (history.mesh.n_cells,)


def test_axes_may_be_functions_of_position():
    """Fibres follow circles about the z axis."""

    def along(x):
        return np.column_stack([-x[:, 1], x[:, 0], 0 * x[:, 0]])

    mesh = vx.meshes.cubes(3, ((1, 2), (0, 1), (0, 1)))
    history = stretched(vx.Orthotropic(E, NU, G, axes=(along, (0.0, 0.0, 1.0))), mesh)
    strain, C = strains(Space(mesh), history.displacement[-1]), elastic_matrix(history.moduli)
    for k in (0, 13):
        x, y, _ = mesh.centroids[k] / np.linalg.norm(mesh.centroids[k, :2])
        R = np.array([[-y, x, 0.0], [0.0, 0.0, 1.0], [x, y, 0.0]])
        e = R @ tensor(strain[k], strain=True) @ R.T
        inside = np.linalg.solve(compliance(), [*np.diag(e), *(2 * e[[0, 1, 0], [1, 2, 2]])])
        np.testing.assert_allclose(tensor(C[k] @ strain[k]), R.T @ tensor(inside) @ R, atol=1e-12)
