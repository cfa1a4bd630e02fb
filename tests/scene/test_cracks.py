"""Cracks that close, slip and open under uniform strain."""

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx

YOUNG, POISSON, FRICTION, HALF, WIDTH = 100.0, 0.3, 0.3, 1.0, 4.0
COURSE = {
    "free": (0.0, 0.0),
    "pressed": (-1.0, 0.0),
    "stuck": (-1.0, 0.2),
    "slips": (-1.0, 0.5),
    "slips on": (-1.0, 0.7),
    "open": (1.0, 0.0),
    "pressed again": (-0.5, 0.0),
}
"""Name of an instant -> the stresses yy and xy in the plate without a crack."""
AT = {name: row for row, name in enumerate(COURSE)}


def gradient(t):
    """Return the displacement gradient in plane strain for the stresses of COURSE, with the stress xx = 0."""
    yy, xy = list(COURSE.values())[round(t)]
    mu = YOUNG / (2 * (1 + POISSON))
    return np.array([[-POISSON * yy, xy], [0.0, (1 - POISSON) * yy]]) / [[2 * mu, mu], [1.0, 2 * mu]]


def plate(n, width=WIDTH):
    """Return a mesh of squares with a crack along edges."""
    mesh = vx.meshes.squares(n, box=((-width, width), (-width, width)))
    x, y = mesh.centroids.T
    near = np.abs(x) < HALF
    return mesh.with_boundary("outside", lambda p: np.full(len(p), True)).cut(
        "crack", {"below": near & (y < 0), "above": near & (y > 0)}
    )


def history_of(mesh):
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(lambda x, t: x @ gradient(t).T, on="outside"),
        vx.UnilateralContact(on="crack"),
        vx.CoulombFriction(FRICTION, on="crack"),
    )
    return vx.simulate(scene, mesh, np.arange(float(len(COURSE))))


def linear(history, name):
    return history.mesh.points @ gradient(AT[name]).T


def opening(history, name):
    """Return the relative displacements of the crack faces along x and y."""
    contact, u = history.contact, history.displacement[AT[name]]
    return (u[contact.partners] - u[contact.nodes]).T


@pytest.fixture(scope="module")
def cracked():
    return history_of(plate(24))


@mostly_long("name", ["pressed", "stuck", "pressed again"])
def test_a_plate_whose_crack_sticks_deforms_as_without_a_crack(cracked, name):
    """The crack sticks before it opens, and sticks again after it closes."""
    assert np.abs(cracked.displacement[AT[name]] - linear(cracked, name)).max() < 1e-13
    assert cracked.contact.closed[AT[name]].all()
    yy, xy = COURSE[name]
    assert cracked.contact.pressure[AT[name]] == pytest.approx(-yy, rel=1e-10)
    assert cracked.contact.traction[AT[name]][:, 0] == pytest.approx(xy, abs=1e-10)


def test_slips_are_proportional_to_the_shear_beyond_friction(cracked):
    """The pressure p does not depend on shear. So slips are proportional to the shear stress minus mu p."""
    (slip, part), (farther, _) = opening(cracked, "slips"), opening(cracked, "slips on")
    assert not cracked.contact.sticking[[AT["slips"], AT["slips on"]]].any()
    assert np.abs(part).max() < 1e-14
    assert farther == pytest.approx((0.7 - FRICTION) / (0.5 - FRICTION) * slip, rel=1e-9)
    lost = FRICTION * farther @ cracked.contact.friction_lengths
    assert cracked.dissipated[AT["slips on"]] == pytest.approx(lost, rel=1e-9)
    assert cracked.dissipated[-1] == pytest.approx(lost, rel=1e-9)


def test_an_open_crack_bears_no_force(cracked):
    row = AT["open"]
    assert not cracked.contact.closed[row].any()
    assert not cracked.contact.pressure[row].any()
    assert not cracked.contact.traction[row].any()


@pytest.mark.slow
def test_the_opening_of_a_plane_crack_converges_to_griffiths_closed_form():
    """The middle of a crack of half-length a in an infinite plate opens by 4 (1 - nu^2) sigma a / E, up to O(h)."""
    exact, found = 4 * (1 - POISSON**2) / YOUNG * HALF, []
    for n in (32, 64, 128):
        history = history_of(plate(n, 2 * WIDTH))
        found.append(opening(history, "open")[1].max() / exact)
    coarse, fine = np.diff(found)
    assert 1.7 < coarse / fine < 2.5
    # The boundary at the distance W = 8 a moves as if there were no crack. The error is at most 2 (a / W)^2.
    assert found[-1] + fine == pytest.approx(1.0, abs=2 / (2 * WIDTH / HALF) ** 2)


# In space.


def round_block(n, far=6.0):
    """Return a quarter of a cylinder about z with a crack of radius 1."""
    away = np.geomspace(1.0, far, 2 * n + 1) - 1.0
    radii = np.append(np.linspace(0.0, 1.0, n + 1), 1.0 + away[1:])
    mesh = vx.meshes.ring(radii, n, angles=(0.0, np.pi / 2)).extruded(np.append(-away[:0:-1], away))
    within, z = np.linalg.norm(mesh.centroids[:, :2], axis=1) < 1.0, mesh.centroids[:, 2]
    return mesh.cut("crack", {"below": within & (z < 0), "above": within & (z > 0)})


@pytest.mark.slow
def test_the_opening_of_a_round_crack_converges_to_sneddons_closed_form():
    """The middle of a crack of radius a opens by 8 (1 - nu^2) sigma a / (pi E) (Sneddon, Proc. R. Soc. A 187, 1946)."""
    found, strain = [], np.diag([-POISSON, -POISSON, 1.0]) / YOUNG
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.Symmetry(on=["first", "last"]),
        vx.PrescribedDisplacement(lambda x, t: t * x @ strain, on=["outer", "bottom", "top"]),
        vx.UnilateralContact(on="crack"),
    )
    for n in (4, 8, 16):
        history = vx.simulate(scene, round_block(n), [0.0, 1.0])
        contact, u = history.contact, history.displacement[-1]
        assert not contact.closed[-1].any()
        lips = (u[contact.partners] - u[contact.nodes])[:, 2]
        found.append(lips.max() * np.pi * YOUNG / (8 * (1 - POISSON**2)))
    coarse, middle, fine = found
    assert fine == pytest.approx(1.0, abs=0.08)
    assert (coarse - 6 * middle + 8 * fine) / 3 == pytest.approx(1.0, abs=0.01)
