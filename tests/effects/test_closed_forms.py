"""Uniform states in closed form, in plane stress, plane strain and space.

Plane strain is plane stress with Young's modulus E / (1 - nu^2), Poisson's ratio nu / (1 - nu), and thermal expansion
(1 + nu) alpha.
"""

from dataclasses import dataclass

import numpy as np
import pytest
from scenes import FAMILIES, rotation, small
from solids import SOLIDS, solid

import vemcvx as vx

E, NU, HEIGHT = 200.0, 0.3, 0.8
MU, LAM = E / (2 * (1 + NU)), E * NU / ((1 + NU) * (1 - 2 * NU))
STEPS = [0.0, 0.5, 1.0]
EXACT = 1e-11
SIDES = [("left", "right"), ("front", "back"), ("bottom", "top")]


@dataclass
class Body:
    """A block in the plane or in space, with its elastic constants."""

    mesh: object
    material: vx.Elasticity
    young: float = E
    poisson: float = NU
    swell: float = 1.0
    lam: float = E * NU / (1 - NU**2)

    @property
    def dim(self):
        return self.mesh.points.shape[1]

    @property
    def foot(self):
        return 1.0 if self.dim == 2 else 1.2

    @property
    def sides(self):
        """Pairs of opposite sides. The last axis is vertical."""
        return SIDES[::2] if self.dim == 2 else SIDES

    @property
    def rollers(self):
        return vx.Symmetry(on=[low for low, _ in self.sides[:-1]])

    @property
    def walls(self):
        return vx.Symmetry(on=[low for low, _ in self.sides])

    def run(self, *effects, times=STEPS, material=None, **options):
        return vx.simulate(vx.Scene(material or self.material, *effects), self.mesh, times, **options)

    def squeezed(self, pressure, floor=0.0):
        """Return the displacement of a block under pressure on top. The floor sinks by `floor`."""
        u = self.mesh.points * ([self.poisson] * (self.dim - 1) + [-1.0]) * pressure / self.young
        u[:, -1] -= floor
        return u

    def stresses(self, *components):
        """Return the stress components for all cells."""
        return np.tile(components, (self.mesh.n_cells, 1))


def make_body(kind):
    plane, name = kind
    if plane == "space":
        return Body(solid(name, 2, ((0, 1), (0, 1.2), (0, HEIGHT))), vx.Elasticity(E, NU), lam=LAM)
    mesh, steel = small(name, 3, box=((0, 1), (0, HEIGHT))), vx.Elasticity(E, NU, plane=plane)
    if plane == "stress":
        return Body(mesh, steel)
    return Body(mesh, steel, E / (1 - NU**2), NU / (1 - NU), 1 + NU, LAM)


KINDS = [("stress", "hanging"), ("strain", "voronoi"), ("space", "cubes")]
OTHERS = [("stress", name) for name in FAMILIES] + [("strain", "squares")] + [("space", name) for name in SOLIDS]
LATER = [pytest.param(kind, marks=pytest.mark.long) for kind in OTHERS if kind not in KINDS]


@pytest.fixture(params=[*KINDS, *LATER], ids=" ".join)
def body(request):
    return make_body(request.param)


def assert_close(found, exact):
    """Check equality up to rounding."""
    assert np.abs(found - exact).max() < EXACT * np.abs(exact).max()


def test_patch_with_mixed_conditions(body):
    """Supports prescribe all components on one side, and one component on two sides."""
    d = body.dim
    slope = np.array([[0.3, -1.2, 0.4], [0.7, 0.4, 0.1], [-0.2, 0.5, 0.6]])[:d, :d] * 1e-2
    strain = 0.5 * (slope + slope.T)
    sigma = 2 * MU * strain + body.lam * np.trace(strain) * np.eye(d)
    along = np.array([2.0, -1.0, 2.0])[:d] / np.linalg.norm([2.0, -1.0, 2.0][:d])
    across = {"right": np.eye(d)[0], "back" if d == 3 else "top": along}

    def u(x, t):
        return t * (x @ slope.T + np.array([0.2, -0.1, 0.3])[:d])

    effects = [vx.PrescribedDisplacement(u, on="bottom")]
    for axis, pair in enumerate(body.sides):
        for name, normal in zip(pair, (-np.eye(d)[axis], np.eye(d)[axis]), strict=True):
            free = np.eye(d)
            if name in across:
                way = across[name]
                free = free - np.outer(way, way)
                given = "normal" if name == "right" else way
                effects.append(vx.PrescribedDisplacement(lambda p, t, w=way: u(p, t) @ w, on=name, direction=given))
            if name != "bottom":
                effects.append(vx.Traction(lambda x, t, force=free @ sigma @ normal: t * force, on=name))
    history = body.run(*effects)
    assert_close(history.displacement[-1], u(body.mesh.points, 1.0))
    rows = ([0, 1, 0], [0, 1, 1]) if d == 2 else ([0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2])
    assert_close(history.stress(-1), body.stresses(*sigma[rows]))
    assert history.energy[-1] == pytest.approx(0.5 * body.foot * HEIGHT * np.sum(sigma * strain), rel=EXACT)
    if d == 3:
        assert_close(history.principal_stresses(-1), body.stresses(*np.linalg.eigvalsh(sigma)[::-1]))
        deviator = sigma - np.trace(sigma) / 3 * np.eye(3)
        assert_close(history.von_mises(-1), np.full(body.mesh.n_cells, np.sqrt(1.5) * np.linalg.norm(deviator)))


def test_pressure_and_symmetry(body):
    history = body.run(body.walls, vx.Pressure(lambda x, t: 3 * t, on="top"))
    assert_close(history.displacement[-1], body.squeezed(3.0))
    assert history.reaction("bottom")[-1] == pytest.approx(3 * body.foot * np.eye(body.dim)[-1], abs=EXACT * 10)


def test_clamp_bears_the_weight(body):
    weight = np.array([2.0, -1.0, -5.0])[-body.dim :]
    history = body.run(vx.Clamp(on="bottom"), vx.BodyForce(lambda x, t: t * weight))
    assert np.abs(history.displacement[:, body.mesh.points[:, -1] == 0]).max() == 0.0
    assert history.reaction("bottom")[-1] == pytest.approx(-body.foot * HEIGHT * weight, rel=EXACT)


def test_elastic_foundation(body):
    """A bed of springs shortens by p / k under the pressure p, and shears by q / k under the shear stress q."""
    press = vx.Pressure(lambda x, t: 3 * t, on="top")
    springs = vx.ElasticFoundation(normal=50.0, tangential=20.0, on="bottom")
    held = body.run(body.rollers, press, springs)
    # Tangential springs restrain the bulge, so the energy is smaller.
    free = body.run(body.rollers, press, vx.ElasticFoundation(normal=50.0, on="bottom"))
    assert_close(free.displacement[-1], body.squeezed(3.0, floor=3.0 / 50.0))
    assert held.energy[-1] < free.energy[-1]
    assert free.energy[-1] == pytest.approx(0.5 * 9 * body.foot * (HEIGHT / body.young + 1 / 50), rel=EXACT)
    up, right = np.eye(body.dim)[-1], np.eye(body.dim)[0]
    slid = body.run(
        vx.PrescribedDisplacement(0.0, on=["bottom", "top"], direction="normal"),
        *([vx.Symmetry(on=["front", "back"])] if body.dim == 3 else []),
        springs,
        *(vx.Traction(lambda x, t, s=s: s * t * up, on=on) for on, s in (("left", -1.0), ("right", 1.0))),
        vx.Traction(lambda x, t: t * right, on="top"),
    )
    assert_close(slid.displacement[-1], np.outer(1 / 20 + body.mesh.points[:, -1] / MU, right))


def test_thermal_strain(body):
    """A free body has no stress. A body blocked along x has stress along x. A clamped body is under pressure."""
    hot = 0.02 * body.swell
    heat = vx.ThermalStrain(1e-3, lambda x, t: 20 * t)
    free = body.run(body.walls, heat)
    assert_close(free.displacement[-1], hot * body.mesh.points)
    assert np.abs(free.stress(-1)).max() < EXACT * E
    # In each step, work - energy increment - dissipation is the energy of the displacement increment.
    stiff = 0.5 * body.foot * HEIGHT * body.dim * (body.dim * body.lam + 2 * MU)
    assert free.energy == pytest.approx(stiff * (hot * np.array(STEPS)) ** 2, rel=1e-11)
    rest = np.diff(free.work - free.energy - free.dissipated)
    assert rest == pytest.approx(stiff * (hot * np.diff(STEPS)) ** 2, rel=1e-9)
    across = body.run(body.walls, vx.Symmetry(on="right"), heat)
    sigma = -body.young * hot
    assert_close(across.stress(-1), body.stresses(sigma, *[0.0] * (2 if body.dim == 2 else 5)))
    assert across.reaction("right")[-1, 0] == pytest.approx(sigma * HEIGHT * body.foot, rel=EXACT)
    assert_close(
        across.displacement[-1], (1 + body.poisson) * hot * body.mesh.points * ([0.0] + [1.0] * (body.dim - 1))
    )
    blocked = body.run(vx.Clamp(on="boundary"), heat)
    sigma = sigma / (1 - (body.dim - 1) * body.poisson)
    assert_close(blocked.stress(-1), body.stresses(*[sigma] * body.dim, *[0.0] * (1 if body.dim == 2 else 3)))
    assert np.abs(blocked.displacement).max() < EXACT * hot


def test_prestress(body):
    """A clamped body keeps the prestress. A free body has no stress."""
    d, shear = body.dim, [0.5, -0.7, 0.3][: 1 if body.dim == 2 else 3]
    stress = np.array([3.0, -1.0, 2.0][:d])
    held = body.run(vx.Clamp(on="boundary"), vx.Prestress(lambda x, t: t * np.array([*stress, *shear])))
    assert_close(held.stress(-1), body.stresses(*stress, *shear))
    # A body in tension pulls its supports inwards, so reactions on the body point outwards.
    assert held.forces[-1][body.mesh.points[:, 0] == 1.0, 0].sum() > 0
    free = body.run(body.walls, vx.Prestress(lambda x, t: t * np.array([*stress, *[0.0] * len(shear)])))
    strain = -((1 + body.poisson) * stress - body.poisson * stress.sum()) / body.young
    assert_close(free.displacement[-1], body.mesh.points * strain)
    assert np.abs(free.stress(-1)).max() < EXACT * 10


def test_normal_compliance_and_a_gap(body):
    """The top sinks by w = gap + p / k + p H / E under the pressure p."""
    w, k, gap = 0.05, 50.0, 0.01
    lid = vx.PrescribedDisplacement(lambda x, t: -w * t, on="top", direction="normal")
    history = body.run(body.rollers, lid, vx.NormalCompliance(k, on="bottom", gap=gap))
    pressure = (w - gap) / (1 / k + HEIGHT / body.young)
    assert_close(history.displacement[-1], body.squeezed(pressure, floor=gap + pressure / k))
    assert history.contact.pressure[-1] == pytest.approx(pressure, rel=1e-9)


def test_one_sided_contact_closes_a_gap(body):
    """The top moves down until the block is squeezed. Then the top moves up and lifts the block."""
    way = vx.Tabulated([0.0, 1.0, 2.0, 3.0], [0.0, -0.01, -0.05, 0.02])
    lid = vx.PrescribedDisplacement(way, on="top", direction="normal")
    touch = vx.UnilateralContact(on="bottom", gap=0.03)
    history = body.run(body.rollers, lid, touch, times=[0.0, 1.0, 2.0, 3.0])
    pressure = body.young * 0.02 / HEIGHT
    assert history.contact.pressure[:2] == pytest.approx(0.0, abs=1e-12)
    assert history.contact.pressure[2] == pytest.approx(pressure, rel=1e-9)
    assert_close(history.displacement[2], body.squeezed(pressure, floor=0.03))
    assert history.contact.closed.all(axis=1).tolist() == [False, False, True, False]
    assert not history.contact.closed[[0, 1, 3]].any()


def test_expansion_of_an_anisotropic_body_turns_with_its_axes():
    """The stress is -alpha theta R diag(b_1, b_2) R', with the rotation R and the row sums b of the stiffness."""
    young, nu, angle, hot = (100.0, 40.0, 30.0), (0.3, 0.2, 0.25), 0.5, 0.048
    wood = vx.Orthotropic(young, nu, 25.0, angle, plane="strain")
    S = np.diag(1 / np.array(young))
    for (i, j), n in zip([(0, 1), (0, 2), (1, 2)], nu, strict=True):
        S[i, j] = S[j, i] = -n / young[i]
    b, R = np.linalg.solve(S, np.ones(3))[:2], rotation(angle)
    exact = -hot * R @ np.diag(b) @ R.T
    scene = vx.Scene(wood, vx.ThermalStrain(1.2e-3, 40.0), vx.Clamp("boundary"))
    stress = vx.simulate(scene, small("voronoi", 3), [0.0, 1.0], initial="settled").stress(-1)
    assert np.abs(stress - [exact[0, 0], exact[1, 1], exact[0, 1]]).max() < EXACT * 100 * hot
