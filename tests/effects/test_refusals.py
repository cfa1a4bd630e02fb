"""Impossible effects: each error names the effect and what was found. whole/messages.txt has more refusals."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import vemcvx as vx
from vemcvx.effects import Contribution, Friction
from vemcvx.effects.contact import obstacle

STEEL, WOOD = vx.Elasticity(200.0, 0.3), {"young": (2.0, 1.0), "poisson": 0.3, "shear": 0.5}
E, NU, G = (120.0, 60.0, 30.0), (0.3, 0.25, 0.35), (20.0, 15.0, 10.0)
HELD, FLOOR = vx.Clamp(on="right"), vx.UnilateralContact(on="bottom")
BELT = {"on": "bottom", "direction": (1.0, 0.0, 0.0)}
EAST, WEST = vx.Elasticity(1.0, 0.3, on="east"), vx.Elasticity(1.0, 0.3, on="west")


def halves(mesh, at=0.5):
    west = mesh.centroids[:, 0] < at
    return mesh.with_cell_data("west", west).with_cell_data("east", ~west).with_cell_data("none", 0 * west)


def wood(**changes):
    return vx.Orthotropic(**{**WOOD, **changes})


def solid(*constants, **changes):
    return vx.Orthotropic(*(constants or (E, NU, G)), **changes)


PLANE = {
    "a scalar force": (vx.PointLoad(3.0, at=(0.5, 0.5)), "PointLoad: found the single number 3; wanted 2 components"),
    "a vector pressure": (vx.Pressure((1, 0), "left"), r"Pressure on left: found an array of shape \(2,\)"),
    "a stress of NaN": (vx.Prestress((1.0, 2.0, np.nan)), "Prestress: found NaN or infinity in 16 of 48 values"),
    "no such datum": (vx.ThermalStrain("alpha", 1.0), "ThermalStrain: expansion: .*no cell datum named 'alpha'"),
    "a direction": (vx.TrescaFriction(1.0, "bottom", direction=(1.0, 0.0), across=2.0), "TrescaFriction .* in space"),
    "a gap of NaN": (vx.UnilateralContact("bottom", np.nan), "UnilateralContact on bottom: gap: found NaN"),
    "no force": (vx.TrescaFriction(1.0, "bottom", while_closed=True), "TrescaFriction on bottom: no pressure is known"),
}  # fmt: skip
MATERIALS = {
    "no material somewhere": ([EAST], "materials: .* 8 have no material .first: cell 0 .*Elasticity on east"),
    "strain beside stress": ([WEST, wood(on="east")], "materials: found plane strain in Elas.*plane stress in Ortho"),
    "no region": ([vx.Elasticity(1.0, 0.3, on="north")], "Elasticity: on= .* found 'north', .* has 'west', 'east'"),
    "an empty region": ([vx.Elasticity(1.0, 0.3, on="none")], "Elasticity: on='none' names no cell"),
    "two moduli": ([wood(plane="strain")], r"Orthotropic: .*plane strain takes \(E1, E2, E3\)"),
    "one ratio": ([wood(young=E, plane="strain")], r"Orthotropic: found poisson = 0\.3; .* takes \(nu12, nu13, nu23\)"),
    "young": ([wood(young=(1.0, lambda x: x[:, 0] - 0.375))], r"Orthotropic: found young \(E2\) = -0\.25 in"),
    "negative energy": ([wood(young=E, poisson=(0.9,) * 3, plane="strain")], r"Orthotropic: .* matrix S of"),
    "no plane": ([wood(plane="foo")], "Orthotropic: found plane 'foo'"),
    "degrees": ([wood(angle=45)], "Orthotropic: found angle = 45 in cell 0; it is in radians"),
    "axes": ([wood(axes=((1, 0, 0), (0, 1, 0)))], "Orthotropic: found axes .* bodies in space; give angle="),
}  # fmt: skip
GROUNDS = {
    "a constant": ((0.5, 0.0), r"found \(0\.5, 0\.0\)"),
    "one component": (lambda x, t: t * x[:, 0], r"found an array of shape \(5,\)"),
    "NaN": (lambda x, t: (np.nan, t), "found NaN or infinity in 5 of 10"),
}  # fmt: skip
ONLY = "exists in the plane only, and this mesh consists of polyhedra"
SPACE = {
    "one shear": ([solid(E, NU, 1.0)], r"Orthotropic: .*shear = 1\.0; a body in space takes \(G12, G13, G23\)"),
    "two moduli": ([solid(E[:2], NU, G)], r"Orthotropic: .*young = .*; a body in space takes \(E1, E2, E3\)"),
    "a plane": ([solid(plane="strain")], f"Orthotropic: plane=: {ONLY}"),
    "parallel axes": ([solid(axes=((1, 0, 0), (2, 0, 0)))], "Orthotropic: axes: .* in cell 0; .* zero nor parallel"),
    "the tangent": ([STEEL, vx.PrescribedDisplacement(0.0, "left", "tangent")], f"Pre.* on left: .*tangent': {ONLY}"),
    "stresses of the plane": ([STEEL, vx.Prestress((1.0, 0.0, 0.0))], r"Prestress: .*wanted 6 components"),
}  # fmt: skip
DIRECTIONS = {
    "across alone": (vx.TrescaFriction(1.0, on="bottom", across=2.0), "TrescaFriction .* takes both direction="),
    "direction alone": (vx.CoulombFriction(1.0, **BELT), "CoulombFriction .* takes both direction="),
    "upright": (vx.TrescaFriction(1.0, "bottom", direction=(0, 0, 2), across=2.0), r"Tresca.*\[0\. 0\. 2\.\]"),
    "a negative bound": (vx.TrescaFriction(1.0, across=-2.0, **BELT), "TrescaFriction on bottom: found across = -2 at"),
    "no bound along": (vx.TrescaFriction(0.0, across=2.0, **BELT), "Tresca.*bound = 0 and across = 2 .*> 0 where"),
    "a ratio that changes": (
        vx.TrescaFriction(lambda x, t: 0.7 * (1 + t), across=0.25, **BELT),
        r"TrescaFriction .*bound = 1\.05 and across = 0\.25 .* t = 0\.5; .*their ratio must not",
    ),
    "a coefficient": (vx.CoulombFriction(-0.1, "bottom"), r"CoulombFriction on bottom: found coefficient = -0\.1"),
    "coefficients that change": (
        vx.CoulombFriction(0.4, across=lambda x, t: 0.1 + t, **BELT),
        r"CoulombFriction .*coefficient = 0\.4 and across = 0\.6 .* t = 0\.5; .*their ratio must not",
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Mine(vx.Effect):
    """A rigid obstacle with friction, some fields of which are replaced."""

    friction: object = None
    stop: object = None

    def contribute(self, space):
        rows = space.part("bottom", "Mine", contact=True).node_normals
        (stop,) = obstacle(space, rows, "Mine", 0.0, np.zeros(len(rows.nodes))).obstacles
        rubs = replace(Friction.from_rows(rows, "Mine"), **(self.friction or {}))
        return Contribution(obstacles=(replace(stop, **(self.stop or {})),), frictions=(rubs,))

    def describe(self):
        return "Mine: on bottom"


def law(weights, slope=None):
    return {"law": vx.Law(weights, pressed=True, slips=False, slope=slope)}


OWN = {
    "a law": (law(lambda t, p, past, slip: (0.3 - past - slip) * p), "law of friction.*without slips=True"),
    "a slope": (law(lambda t, p, *_: 0.3 * p, lambda t, p, past: np.ones(len(past))), "slope.*slips=True"),
    "weights": ({"weights": lambda t: np.full(5, np.nan if t else 1.0)}, "weights at t = 0.5: found NaN"),
    "compliance": ({"compliance": np.full(5, np.nan)}, "compliance: found NaN"),
    "a gap": ({"gap": lambda t: np.full(5, np.inf if t else 0.0)}, "gap at t = 0.5: found NaN"),
    "other rows": ({"gap": lambda t: np.zeros(2)}, r"gap at t = 0: found .* \(2,\); wanted one number, or \(5,\)"),
}  # fmt: skip


def own(given):
    changes = {"stop" if given.keys() & {"gap", "compliance"} else "friction": given}
    return [STEEL, HELD, vx.Traction((0.0, -1.0), on="top"), Mine(**changes)]


CASES = (
    {f"plane, {name}": ("squares", [STEEL, HELD, one], says) for name, (one, says) in PLANE.items()}
    | {f"material, {name}": ("squares", [HELD, *some], says) for name, (some, says) in MATERIALS.items()}
    | {f"space, {name}": ("cubes", [HELD, *some], says) for name, (some, says) in SPACE.items()}
    | {f"direction, {name}": ("cubes", [STEEL, HELD, FLOOR, one], says) for name, (one, says) in DIRECTIONS.items()}
    | {
        f"ground of {kind.__name__}, {name}": (
            "squares",
            [STEEL, HELD, FLOOR, kind(0.3, "bottom", ground=one)],
            f"{kind.__name__} on bottom: ground: {says}",
        )
        for name, (one, says) in GROUNDS.items()
        for kind in (vx.TrescaFriction, vx.CoulombFriction)
    }
    | {f"one's own, {name}": ("squares", own(one), f"Mine: .*{says}") for name, (one, says) in OWN.items()}
)


@pytest.mark.parametrize(("family", "effects", "says"), CASES.values(), ids=CASES)
def test_an_impossible_effect_is_refused_by_name(family, effects, says):
    mesh = halves(vx.meshes.squares(4) if family == "squares" else vx.meshes.cubes(2))
    own = any(isinstance(effect, Mine) for effect in effects)
    with pytest.raises(vx.SceneError, match=f"(?s)^{says}"):
        vx.simulate(vx.Scene(*effects), mesh, [0.0, 0.5, 1.0], initial="settled" if own else None)


def test_tables_refuse_infinite_values_and_times_that_they_do_not_cover():
    with pytest.raises(vx.SceneError, match=r"^Tabulated: .*wanted 2 finite values"):
        vx.Tabulated([0.0, 1.0], [1.0, np.inf])
    covers = vx.Tabulated([0.0, 1.0], [[0.0, 0.0], [1.0, 0.0]])
    with pytest.raises(vx.SceneError, match=r"^Tabulated: found t = 1\.5; .* covers times"):
        covers(None, 1.5)


@pytest.mark.parametrize("mesh", [vx.meshes.triangles(2), vx.meshes.tetrahedra(1)], ids=["plane", "space"])
def test_simplices_near_incompressibility_cause_a_warning(mesh):
    with pytest.warns(vx.SceneWarning, match=r"^Elasticity: poisson = 0\.4999 on a mesh of .*, which lock near 1/2"):
        vx.simulate(vx.Scene(vx.Elasticity(200.0, 0.4999), vx.Clamp(on="bottom")), mesh, [0.0, 1.0])
