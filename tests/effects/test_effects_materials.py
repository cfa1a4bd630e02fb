"""Materials of parts of a body, and Orthotropic in the plane."""

import dataclasses

import numpy as np
import pytest
from scenes import any_family, mostly_long, small
from test_effects_loads_and_supports import Pin, is_near

import vemcvx as vx

BOX = ((0.0, 2.0), (0.0, 1.0))


def halves(mesh, at=1.0):
    west = mesh.centroids[:, 0] < at
    return mesh.with_cell_data("west", west).with_cell_data("east", ~west)


@pytest.mark.parametrize("family", ["squares", "triangles"])
def test_a_bar_of_two_materials_has_two_strains(family):
    """Under the tension s between rollers, part i has e_xx = s / (lam_i + 2 mu_i) and sigma_yy = lam_i e_xx."""
    mesh = halves(small(family, 4, box=BOX))
    s, E, nu = 3.0, (100.0, 400.0), (0.2, 0.4)
    materials = [vx.Elasticity(E[i], nu[i], on=on) for i, on in enumerate(("west", "east"))]
    scene = vx.Scene(*materials, vx.Symmetry(["left", "bottom", "top"]), vx.Traction((s, 0.0), "right"))
    history = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    lam = [e * n / ((1 + n) * (1 - 2 * n)) for e, n in zip(E, nu, strict=True)]
    strain = [s / (la + e / (1 + n)) for la, e, n in zip(lam, E, nu, strict=True)]
    x = mesh.points[:, 0]
    exact = strain[0] * np.minimum(x, 1.0) + strain[1] * np.maximum(x - 1.0, 0.0)
    assert is_near(history.displacement[-1], np.column_stack([exact, 0 * x]), exact.max())
    across = np.where(mesh.cell_data["west"], lam[0] * strain[0], lam[1] * strain[1])
    assert is_near(history.stress(-1), np.column_stack([s + 0 * across, across, 0 * across]), s)
    assert is_near(history.reaction("left")[-1, 0], -s, s)


@any_family
@mostly_long("degrees", [0.0, 25.0, 90.0], 1)
def test_a_plate_pulled_at_an_angle_to_its_axes_stretches_and_shears(family, degrees):
    """The closed form is equation 2.97 of Jones, Mechanics of Composite Materials, 1999."""
    E1, E2, nu, G, s = 140.0, 10.0, 0.3, 5.0, 2.0
    a = np.radians(degrees)
    c2, s2, cs = np.cos(a) ** 2, np.sin(a) ** 2, np.cos(a) * np.sin(a)
    pulled = c2**2 / E1 + (1 / G - 2 * nu / E1) * c2 * s2 + s2**2 / E2
    across = (1 / E1 + 1 / E2 - 1 / G) * c2 * s2 - nu / E1 * (c2**2 + s2**2)
    sheared = cs * (2 * c2 / E1 - 2 * s2 / E2 + (2 * nu / E1 - 1 / G) * (c2 - s2))
    mesh = small(family, 3, box=BOX)
    corner, other = (int(np.argmin(np.linalg.norm(mesh.points - p, axis=1))) for p in ((0, 0), (2, 0)))
    history = vx.simulate(
        vx.Scene(
            vx.Orthotropic((E1, E2), nu, G, a),
            vx.Traction((s, 0.0), "right"),
            vx.Traction((-s, 0.0), "left"),
            Pin(corner),
            Pin(other, (1,)),
        ),
        mesh,
        [0.0, 1.0],
        initial="settled",
    )
    exact = s * mesh.points @ np.array([[pulled, 0.0], [sheared, across]])
    assert is_near(history.displacement[-1], exact, np.abs(exact).max())
    assert is_near(history.stress(-1), [s, 0.0, 0.0], s)
    assert is_near(history.forces[-1], 0.0, s)
    assert history.energy[-1] == pytest.approx(0.5 * s**2 * pulled * 2.0, rel=1e-11)


@pytest.mark.long
def test_the_stabilisation_does_not_lock_on_stiff_fibres():
    """If fibres along x are inextensible, a body force b causes u_y = b x (1 - x) / (2 G), with energy b^2 / (24 G)."""
    G, b, mesh = 5.0, 1.0, small("voronoi", 8)
    stiff = vx.Orthotropic((1e9, 10.0), 0.0, G)

    class Trace(vx.Stabilisation):
        def form(self, cells, C):
            return np.trace(C, axis1=1, axis2=2)[:, None, None] * np.eye(cells.nodes.shape[1])

    def share(stabilisation):
        material = dataclasses.replace(stiff, stabilisation=stabilisation)
        scene = vx.Scene(material, vx.Clamp(["left", "right"]), vx.BodyForce((0.0, b)))
        energy = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled", check=False).energy[-1]
        return energy / (b**2 / (24 * G))

    # The share is 1.037 for "shear", and tends to 1 as h tends to 0. For `Trace` it is 2e-6.
    assert share("shear") == pytest.approx(1.0, abs=0.06)
    assert share(Trace()) < 0.01
