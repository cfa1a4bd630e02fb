"""Displacements at supports are exact."""

import numpy as np
import pytest
from scenes import FAMILIES, mostly_long, moved, rotation, small

import vemcvx as vx
from vemcvx.scene import pose_scene

TIMES = np.linspace(0.0, 1.0, 9)
EPS = np.finfo(float).eps
STEEL = vx.Elasticity(young=200.0, poisson=0.3)


def held_by(history, name, direction):
    """Return the displacements (steps, nodes) along a direction at a part of the boundary."""
    nodes = np.unique(history.mesh.boundaries[name])
    return history.displacement[:, nodes] @ np.asarray(direction)


@mostly_long("degrees", [0.0, 30.0], 1)
def test_a_corner_of_the_contact_boundary_is_held_in_both_normal_directions(degrees):
    R = rotation(np.radians(degrees))
    mesh = moved(small("squares", 4), R)
    scene = vx.Scene(
        STEEL,
        vx.BilateralContact(on=["bottom", "right"]),
        vx.TrescaFriction(bound=0.5, on=["bottom", "right"]),
        vx.Traction(lambda x, t: t * R @ [3.0, -5.0], on=["left", "top"]),
    )
    history = vx.simulate(scene, mesh, TIMES)
    size = np.abs(history.displacement).max()
    assert np.abs(held_by(history, "bottom", R @ [0, -1])).max() < 4 * EPS * size
    assert np.abs(held_by(history, "right", R @ [1, 0])).max() < 4 * EPS * size
    (corner,) = np.intersect1d(mesh.boundaries["bottom"], mesh.boundaries["right"])
    # The corner is held in both directions, so its displacement is exactly zero.
    assert np.array_equal(history.displacement[:, corner], np.zeros((len(TIMES), 2)))
    assert corner not in history.contact.nodes
    assert len(history.contact.nodes) == 8
    # All contact nodes slide, including the ends of the contact boundary.
    assert np.abs(history.contact.slip[-1]).max(axis=1).min() > 1e-6 * size


@mostly_long("degrees", [0.0, 30.0], 1)
def test_a_clamp_wins_at_shared_nodes(degrees):
    R = rotation(np.radians(degrees))
    mesh = moved(small("squares", 4), R)
    pull = vx.Traction(lambda x, t: np.sin(6 * t) * R @ [8.0, -1.0], on="left")
    held = vx.Clamp(on="right"), vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound=4.0, on="bottom")
    history = vx.simulate(vx.Scene(STEEL, pull, *held), mesh, TIMES)
    assert np.array_equal(held_by(history, "right", np.eye(2)), np.zeros((len(TIMES), 5, 2)))
    shared = np.intersect1d(mesh.boundaries["bottom"], mesh.boundaries["right"])
    assert len(history.contact.nodes) == 4
    assert not np.isin(shared, history.contact.nodes).any()


@pytest.mark.parametrize(
    ("direction", "unit"),
    [
        ("normal", (0, -1)),
        ("tangent", (1, 0)),
        ((3.0, 4.0), (0.6, 0.8)),
        ([-1e200, 0.0], (-1, 0)),
        ((0, 1e-200), (0, 1)),
    ],
    ids=str,
)
@mostly_long("degrees", [0.0, 30.0], 1)
def test_one_component_is_prescribed_and_the_other_is_free(direction, unit, degrees):
    R = rotation(np.radians(degrees))
    mesh = moved(small("voronoi", 3), R)
    given = direction if isinstance(direction, str) else tuple(R @ np.array(direction))

    def value(x, t):
        return 0.02 * t * (2 - (x @ R)[:, 0])

    scene = vx.Scene(STEEL, vx.Clamp(on="top"), vx.PrescribedDisplacement(value, on="bottom", direction=given))
    history = vx.simulate(scene, mesh, TIMES)
    nodes = np.unique(mesh.boundaries["bottom"])
    wanted = np.array([value(mesh.points[nodes], t) for t in TIMES])
    along = R @ np.array(unit, dtype=float)
    assert np.abs(held_by(history, "bottom", along) - wanted).max() < 8 * EPS * wanted.max()
    across = held_by(history, "bottom", rotation(np.pi / 2) @ along)
    assert np.abs(across[-1]).max() > 1e-3 * wanted.max()
    # Reactions are along the direction of the support, up to the rounding of K u.
    forces = history.forces[:, nodes]
    assert np.abs(forces @ (rotation(np.pi / 2) @ along)).max() < 1e-12 * np.abs(forces).max()


@pytest.mark.filterwarnings("ignore:.*nothing holds the body in the normal direction")
@mostly_long("family", FAMILIES, "voronoi", "hanging", "triangles")
@mostly_long("degrees", [0.0, 30.0], 1)
@pytest.mark.parametrize("surface", ["contact", "part of the contact", "no contact"])
def test_every_friction_term_has_one_unknown(family, degrees, surface):
    """Sticking is exact if each friction term has one unknown."""
    R = rotation(np.radians(degrees))
    mesh = moved(small(family, 4), R)
    # The normals of a part and of the whole side differ by rounding.
    mesh = mesh.with_boundary("rough", lambda x: (np.abs((x @ R)[:, 1]) < 1e-9) & ((x @ R)[:, 0] < 0.6))
    on = "rough" if surface == "part of the contact" else "bottom"
    contact = [] if surface == "no contact" else [vx.BilateralContact(on="bottom")]
    posed = pose_scene(vx.Scene(STEEL, vx.Clamp(on="top"), *contact, vx.TrescaFriction(4.0, on=on)), mesh)
    B = posed.system.norms.B
    assert B.shape[0] == len(np.unique(mesh.boundaries[on]))
    assert np.array_equal(np.diff(B.indptr), np.ones(B.shape[0]))
    assert len(np.unique(B.indices)) == B.shape[0]
    assert np.array_equal(np.abs(B.data), np.ones(B.shape[0]))
    assert (posed.system.K - posed.system.K.T).nnz == 0


def test_a_body_held_everywhere_has_no_unknowns():
    history = vx.simulate(
        vx.Scene(STEEL, vx.PrescribedDisplacement(lambda x, t: t * x, on="boundary")), small("squares", 1), TIMES
    )
    assert np.array_equal(history.displacement, TIMES[:, None, None] * history.mesh.points)
    assert not history.certificate.any()
    # The energy of u = t x on the unit square is 1/2 t^2 (4 mu + 4 lam).
    lam, mu = history.moduli[:, 0]
    assert history.energy == pytest.approx(0.5 * TIMES**2 * (4 * mu + 4 * lam), rel=1e-14)
