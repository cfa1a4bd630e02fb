"""Bodies of revolution: patch tests, Lame's tube, a press fit, and refusals."""

from dataclasses import dataclass

import meshio
import numpy as np
import pytest

import vemcvx as vx
from vemcvx.effects import Contribution, Material
from vemcvx.vem import Space, stiffness
from vemcvx.vem.tensors import moduli_of_revolution

FAMILIES = ("squares", "triangles", "voronoi", "hexagons", "nonconvex", "hanging")
MU = 1.0 / 2.6  # for young = 1, poisson = .3
FIELDS = {  # displacement (u_r, u_z), and the body force that balances the stresses
    "u_r = r": (lambda x: np.column_stack([x[:, 0], 0.0 * x[:, 0]]), None),
    "u_z = z": (lambda x: np.column_stack([0.0 * x[:, 0], x[:, 1]]), None),
    "u_z = r": (lambda x: np.column_stack([0.0 * x[:, 0], x[:, 0]]), lambda x, t: [[0.0, -MU / r] for r in x[:, 0]]),
}


def steel(young=1.0, poisson=0.3):
    return vx.Elasticity(young=young, poisson=poisson, plane="axisymmetric")


@pytest.mark.arithmetic
@pytest.mark.parametrize("inner", [0.0, 1.0, 1000.0])
@pytest.mark.parametrize("family", FAMILIES)
def test_fields_of_constant_strain_are_exact_at_any_radius(family, inner):
    mesh = getattr(vx.meshes, family)(5, box=((inner, inner + 1.0), (0.0, 0.5)))
    for u, force in FIELDS.values():
        exact = 1e-3 * u(mesh.points)
        held = vx.PrescribedDisplacement(lambda x, t, u=u: 1e-3 * u(x), on="boundary")
        loads = [] if force is None else [vx.BodyForce(lambda x, t, f=force: 1e-3 * np.array(f(x, t)))]
        history = vx.simulate(vx.Scene(steel(), held, *loads), mesh, [0.0, 1.0], initial="equilibrium")
        # The relative error grows with the condition number of the stiffness, at most 150 here.
        assert np.abs(history.displacement[-1] - exact).max() <= 1e-11 * np.abs(exact).max()


@pytest.mark.parametrize("family", FAMILIES)
def test_only_the_translation_along_the_axis_has_no_energy(family):
    mesh = getattr(vx.meshes, family)(1, box=((1.0, 2.0), (0.0, 1.0)))
    A = stiffness(Space(mesh, axisymmetric=True), *np.ones((2, mesh.n_cells))).toarray()
    values = np.linalg.eigvalsh(A)
    assert np.array_equal(A, A.T)
    assert abs(values[0]) < 1e-14 * values[-1] < 1e-10 * values[-1] < values[1]
    assert np.abs(A @ np.tile([0.0, 1.0], mesh.n_nodes)).max() < 1e-14 * values[-1]


def lame(r, pressure, inner, outer, young, poisson):
    """Return u_r of a tube in plane strain under inner pressure (Lame, 1852)."""
    k = pressure * inner**2 / (outer**2 - inner**2)
    return (1.0 + poisson) / young * k * ((1.0 - 2.0 * poisson) * r + outer**2 / r)


def tube(mesh, poisson):
    scene = vx.Scene(steel(1000.0, poisson), vx.Pressure(10.0, on="left"), vx.Symmetry(on=["bottom", "top"]))
    return vx.simulate(scene, mesh, [0.0, 1.0], initial="equilibrium")


@pytest.mark.parametrize("poisson", [0.3, 0.4999])
@pytest.mark.parametrize("family", ["squares", "voronoi", "hexagons"])
def test_lames_tube_has_errors_of_first_order_and_does_not_lock(family, poisson):
    errors = []
    for n in (8, 32):
        mesh = getattr(vx.meshes, family)(n, box=((1.0, 2.0), (0.0, 0.5)))
        history = tube(mesh, poisson)
        exact = lame(mesh.points[:, 0], 10.0, 1.0, 2.0, 1000.0, poisson)
        # The energy is half the work of the pressure. The square root of the energy error is of order h.
        energy = 0.5 * 10.0 * (2.0 * np.pi * 1.0 * 0.5) * lame(1.0, 10.0, 1.0, 2.0, 1000.0, poisson)
        errors.append(np.sqrt(abs(history.energy[-1] / energy - 1.0)))
        assert np.allclose(history.force(vx.Pressure)[-1], [2.0 * np.pi * 1.0 * 0.5 * 10.0, 0.0], rtol=1e-12)
    assert np.abs(history.displacement[-1, :, 0] - exact).max() < 1e-3 * exact.max()
    assert np.log2(errors[0] / errors[1]) / 2.0 > 0.9
    cell = int(np.argmin(np.abs(mesh.centroids - [1.5, 0.25]).sum(axis=1)))
    hoop = 10.0 / 3.0 * (1.0 + 4.0 / mesh.centroids[cell, 0] ** 2)
    assert history.out_of_plane_stress(1)[cell] == pytest.approx(hoop, rel=0.02)
    assert np.array_equal(history.principal_stresses(1)[:, 0], history.out_of_plane_stress(1))


@pytest.fixture(scope="module")
def press_fit():
    """Return the history of a hub that is shrunk by .002 onto a shaft of equal length, and pushed off."""
    shaft, hub = (vx.meshes.squares((4, 40), box=((r, r + 1.0), (0.0, 20.0))) for r in (1.0, 2.0))
    mesh = vx.meshes.bodies({"hub": hub, "shaft": shaft})
    scene = vx.Scene(
        steel(1000.0, 0.0),  # without Poisson's effect, friction and pressure are independent
        vx.UnilateralContact(on="hub|shaft", gap=lambda x, t: np.full(len(x), -2e-3 * min(t, 1.0))),
        vx.CoulombFriction(0.2, on="hub|shaft"),
        vx.PrescribedDisplacement(0.0, on="shaft.bottom", direction=(0.0, 1.0)),
        vx.PrescribedDisplacement(lambda x, t: np.full(len(x), 0.2 * max(t - 1.0, 0.0)), "hub.bottom", (0.0, 1.0)),
    )
    return vx.simulate(scene, mesh, [0.0, 1.0, 1.5, 2.0])


def test_the_force_that_pushes_a_hub_off_is_the_friction_under_lames_pressure(press_fit):
    # For the interference d and the radii a = 1, b = 2, c = 3, Lame's pressure in plane stress is p = E d / (b (C + D))
    # with C = (b^2 + a^2) / (b^2 - a^2) and D = (c^2 + b^2) / (c^2 - b^2).
    pressure = 1000.0 * 2e-3 / 2.0 / ((4.0 + 1.0) / (4.0 - 1.0) + (9.0 + 4.0) / (9.0 - 4.0))
    push = 0.2 * pressure * 2.0 * np.pi * 2.0 * 20.0
    assert press_fit.reaction("hub.bottom")[-1, 1] == pytest.approx(push, rel=0.01)
    assert press_fit.contact.slip_count[-1] == len(press_fit.contact.nodes)


def test_files_keep_bodies_of_revolution_and_contain_the_radii(press_fit, tmp_path):
    folder = press_fit.write(tmp_path / "run")
    again = vx.read_history(folder)
    assert again.is_axisymmetric
    assert "per full turn" in again.summary()
    for field, values in press_fit.on_cells(3).items():
        assert np.array_equal(again.on_cells(3)[field], values)
    assert np.array_equal(meshio.read(folder / "step_0003.vtu").point_data["radius"], press_fit.mesh.points[:, 0])


def test_the_axis_is_held_radially():
    scene = vx.Scene(steel(), vx.Symmetry(on=["left", "bottom"]), vx.Pressure(1e-3, on="right"))
    history = vx.simulate(scene, vx.meshes.squares(2), [0.0, 1.0], initial="equilibrium")
    exact = -0.7e-3 * history.mesh.points[:, 0]  # -(1 - nu) p r / E
    assert history.displacement[-1, :, 0] == pytest.approx(exact, abs=1e-15)


def test_contact_on_the_axis_is_refused():
    scene = vx.Scene(steel(), vx.Symmetry(on="bottom"), vx.UnilateralContact(on=["left", "top"]))
    with pytest.raises(vx.SceneError, match=r"found sides on the axis.*Nodes on the axis are held radially"):
        vx.simulate(scene, vx.meshes.squares(2), [0.0, 1.0])


@dataclass(frozen=True)
class Own(vx.effects.MaterialLaw):
    """A user-defined material with Lame's constants lam = mu = 1."""

    plane: str = "axisymmetric"

    def contribute(self, space):
        n = space.mesh.n_cells
        moduli = moduli_of_revolution(np.ones(n), np.ones(n))
        return Contribution(material=Material("Own", moduli, np.zeros((n, space.components)), "axisymmetric"))

    def describe(self):
        return "Own: lam = mu = 1"


def test_a_user_defined_material_agrees_with_the_material_of_the_package():
    mesh, rest = vx.meshes.voronoi(4), (vx.Symmetry(on="bottom"), vx.Pressure(1e-3, on="top"))
    own, ours = (
        vx.simulate(vx.Scene(one, *rest), mesh, [0.0, 1.0], initial="equilibrium") for one in (Own(), steel(2.5, 0.25))
    )
    assert own.displacement == pytest.approx(ours.displacement, abs=1e-14)
    with pytest.raises(vx.SceneError, match="a material of a body of revolution has the attribute plane"):
        vx.simulate(vx.Scene(Own(plane="strain"), *rest), mesh, [0.0, 1.0])
