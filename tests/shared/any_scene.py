"""Random scenes for tests of certificates and error estimates.

``draw(seed)`` returns a scene on a small mesh, instants, a solver and settings. Equal seeds give equal scenes.
``draw_two_bodies(seed)`` replaces the ground by a second body.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field, replace

import numpy as np
from scenes import FAMILIES, SEEDED, drawn, moved, rotation

import vemcvx as vx
from vemcvx.scene import pose_scene

SIDES = ("left", "right", "bottom", "top")


@dataclass
class Drawn:
    """A scene and the settings of its run."""

    seed: int
    effects: list
    mesh: vx.PolygonMesh
    times: np.ndarray
    solver: vx.Solver | None
    linear: object
    condense: bool
    start: str
    kinds: set = field(default_factory=set)
    """Kinds of effects and settings, as listed in :func:`draw`."""

    @property
    def scene(self):
        return vx.Scene(*self.effects)

    @property
    def words(self):
        """A description of the scene."""
        effects = "; ".join(effect.describe() for effect in self.effects)
        return (
            f"any_scene.draw({self.seed}): {self.mesh!r}, {len(self.times) - 1} steps, {self.solver!r}, "
            f"linear={self.linear!r}, condense={self.condense}, start={self.start!r}, kinds={sorted(self.kinds)}: "
            f"{effects}"
        )


@dataclass
class _Course:
    """A function of time that is linear between the instants of a run."""

    times: np.ndarray
    values: np.ndarray

    def __call__(self, t):
        return float(np.interp(t, self.times, self.values))


class _Draw:
    """The random choices that make one scene."""

    def __init__(self, seed):
        self.seed, self.rng = seed, np.random.default_rng([seed, 20])
        self.belts = np.random.default_rng([seed, 42])
        self.kinds = set()
        self.length = self._ten(-3, 3)
        self.young = self._ten(-3, 10)
        self.strain = self._ten(-6, -1.5)
        self.period = self._ten(-2, 3)
        if self.chance(0.04):
            self.strain *= self._ten(-60, 60)
            self.kinds.add("extreme loads")
        steps = int(self.rng.integers(1, 6))
        begin = self.period * self.rng.choice([0.0, 0.0, 3.0])
        self.times = begin + self.period * np.append(0.0, np.cumsum(10 ** self.rng.uniform(-1.5, 0, steps)))
        self.late = False

    def chance(self, p):
        return self.rng.random() < p

    def one(self, *things):
        return things[int(self.rng.integers(len(things)))]

    def _ten(self, low, high):
        return float(10.0 ** self.rng.uniform(low, high))

    # Space

    def mesh(self):
        family = drawn(self.one(*FAMILIES[: len(SEEDED)]), self.seed)
        most = 4 if family in ("voronoi", "squares", "triangles", "distorted") else 3
        n = tuple(int(k) for k in self.rng.integers(1, most, 2))
        wide = self._ten(-0.4, 0.4)
        if self.chance(0.06):
            self.kinds.add("thin")
            wide = self._ten(-4, 4)
        x, y = self.length * self.rng.choice([0.0, 0.0, 1.0, -30.0], 2)
        box = ((x, x + wide * self.length), (y, y + self.length))
        mesh = vx.meshes.FAMILIES[family](n, box=box, seed=int(self.rng.integers(100)))
        middle = x + wide * self.length * self.rng.uniform(0.3, 0.7)
        parts = {
            "west": lambda m: (m[:, 0] < middle) & (np.abs(m[:, 1] - y) < 1e-6 * self.length),
            "east": lambda m: (m[:, 0] >= middle) & (np.abs(m[:, 1] - y) < 1e-6 * self.length),
        }
        for name, inside in parts.items():
            if inside(_midpoints(mesh, "bottom")).any():
                mesh = mesh.with_boundary(name, inside)
        angle = self.rng.uniform(-3, 3) if self.chance(0.2) else 0.0
        if angle:
            self.kinds.add("turned")
            mesh = moved(mesh, rotation(angle))
        self.along = np.array([np.cos(angle), np.sin(angle)])
        self.up = np.array([-np.sin(angle), np.cos(angle)])
        inside = self.rng.random(mesh.n_cells) < 0.5
        inside[0] = True
        self.two = bool(inside.any() and not inside.all() and self.chance(0.15))
        self.built = mesh.with_cell_data("hard", inside.astype(float)).with_cell_data("soft", (~inside).astype(float))
        return self.built

    def field(self, size, low=0.0, high=1.0):
        """Return an affine function of place with values between low * size and high * size."""
        points = self.built.points
        lo, span = points.min(axis=0), np.ptp(points, axis=0)
        c = self.rng.uniform(low, high, 3)
        return lambda x: size * (c[0] + (c[1:] - c[0]) @ ((x - lo) / span).T * 0.5)

    # Time

    def course(self):
        """Return a function of time that is zero at times[0], unless the run begins under load."""
        n = len(self.times)
        kind = self.one("ramp", "free", "few", "turns", "held")
        if kind == "ramp":
            values = np.linspace(0, 1, n)
        elif kind == "free":
            values = self.rng.uniform(-1, 1, n)
        elif kind == "few":
            values = self.rng.choice([0.0, 1.0, -1.0, 0.5, 1 + 1e-9], n)
        elif kind == "turns":
            values = np.sin(np.linspace(0, self.rng.uniform(3, 9), n))
        else:
            values = np.ones(n)
        if not self.late:
            values = values.copy()
            values[0] = 0.0
        return _Course(self.times, np.asarray(values, dtype=float))

    def pressing(self):
        """Return a function of time with values >= 0."""
        values = np.linspace(0, 1, len(self.times)) if self.chance(0.5) else self.rng.uniform(0.3, 1, len(self.times))
        if not self.late:
            values[0] = 0.0
        return _Course(self.times, values)

    # Physics

    def materials(self):
        triangles = (np.diff(self.built.offsets) == 3).any()
        if self.two:
            self.kinds.add("two materials")
            parts = ("hard", 10 ** self.rng.uniform(-3, 3)), ("soft", 1.0)
            return [self.material(on, factor, triangles) for on, factor in parts]
        return [self.material(None, 1.0, triangles)]

    def material(self, on, factor, triangles):
        E, plane = self.young * factor, "strain"
        if self.chance(0.15):
            self.kinds.add("orthotropic")
            E2, E3 = E * self._ten(-1, 0), E * self._ten(-1, 0)
            G, angle = E * self._ten(-1.5, -0.3), self.rng.uniform(-2, 2)
            return vx.Orthotropic((E, E2, E3), (0.2, 0.1, 0.1), G, angle, plane, on=on)
        nu = self.one(0.3, 0.3, 0.3, 0.0, *self.rng.uniform(-0.9, 0.49, 6), 0.499, 0.499999, 0.5 - 1e-10)
        if triangles:
            nu = min(nu, 0.45)
        if nu > 0.499:
            self.kinds.add("incompressible")
        if self.chance(0.1) and on is None:
            E = E * 10 ** self.rng.uniform(-3, 3, self.built.n_cells)
            self.kinds.add("contrast")
        return vx.Elasticity(E, nu, plane, "unit" if self.chance(0.06) else "shear", on)

    def traction(self, side, size):
        f, course = [self.field(size, -1, 1) for _ in range(2)], self.course()
        return vx.Traction(lambda x, t: course(t) * np.column_stack([g(x) for g in f]), on=side)

    def force(self):
        """Return a load of a random kind."""
        stress = self.young * self.strain
        kind = self.one("traction", "pressure", "body", "point", "heat", "prestress")
        course, f, g = self.course(), self.field(stress, -1, 1), self.field(stress, -1, 1)
        if kind == "traction":
            return self.traction(self.one(*SIDES), stress)
        if kind == "pressure":
            return vx.Pressure(lambda x, t: course(t) * f(x), on=self.one(*SIDES))
        if kind == "body":
            return vx.BodyForce(lambda x, t: course(t) * np.column_stack([f(x), g(x)]) / self.length)
        if kind == "point":
            node = self.built.points[int(self.rng.integers(self.built.n_nodes))]
            push = stress * self.length * self.rng.uniform(-1, 1, 2)
            return vx.PointLoad(lambda x, t: course(t) * np.tile(push, (len(x), 1)), at=node)
        if kind == "heat":
            self.kinds.add("heat")
            return vx.ThermalStrain(self.strain / 10, lambda x, t: 10 * course(t) * f(x) / stress)
        self.kinds.add("prestress")
        h = self.field(stress, -1, 1)
        return vx.Prestress(lambda x, t: course(t) * np.column_stack([f(x), g(x), h(x)]))

    def bound(self):
        """Return a random friction bound."""
        size = self.young * self.strain * self._ten(-2, 0.3)
        kind = self.one("constant", "constant", "varies", "in time", "zero in places", "huge", "zero", "jumps")
        f, course = self.field(size), self.pressing()
        if kind == "constant":
            return size
        if kind == "huge":
            return 1e6 * size
        if kind == "zero":
            return 0.0
        if kind == "in time":
            return lambda x, t: np.full(len(x), size * (0.2 + course(t)))
        if kind == "jumps":
            when = self.rng.choice(self.times)
            return lambda x, t: np.full(len(x), size if t < when else 0.1 * size)
        if kind == "zero in places":
            return lambda x, t: np.maximum(f(x) - 0.3 * size, 0.0)
        return lambda x, t: f(x)

    def tresca(self, side):
        if self.chance(0.2):
            self.bound()  # Without this call, later random numbers would change.
        rule = self.one("nodes", "nodes", "integral")
        return vx.TrescaFriction(self.bound(), on=side, quadrature=rule, ground=self.ground())

    def coulomb(self, side):
        self.kinds.add("Coulomb")
        cap = None
        if self.chance(0.15):
            self.kinds.add("capped")
            cap = self.young * self.strain * self._ten(-1, 0)
        mu = self.rng.uniform(0.05, 0.6)
        f = self.field(mu, 0.5, 1.0)
        return vx.CoulombFriction(mu if self.chance(0.6) else lambda x, t: f(x), on=side, cap=cap, ground=self.ground())

    def ground(self):
        """Return a displacement of the ground, or None."""
        if self.belts.random() > 0.12:
            return None
        self.kinds.add("belt")
        far = self.length * self.strain * 10 ** self.belts.uniform(-1, 3)
        way, spin = self.belts.uniform(-1, 1, 2), self.belts.uniform(-1, 1) / self.length
        course = _Course(self.times, self.belts.uniform(-1, 1, len(self.times)))
        return lambda x, t: far * course(t) * (way + spin * np.column_stack([-x[:, 1], x[:, 0]]))

    def gap(self):
        move = self.length * self.strain
        kind = self.one("none", "none", "constant", "varies", "moves", "far")
        f, course = self.field(move), self.course()
        if kind == "none":
            return 0.0
        if kind == "constant":
            return move * self._ten(-2, 0)
        if kind == "far":
            return 1e3 * move
        if kind == "moves":
            self.kinds.add("gap moves")
            return lambda x, t: move * 0.3 * abs(course(t)) * np.ones(len(x))
        return lambda x, t: f(x)

    def contact(self, side, free=False):
        """Return contact and friction on one side."""
        kinds = ("bilateral", "unilateral", "unilateral", "soft") if not free else ("unilateral", "soft", "bilateral")
        kind = self.one(*kinds)
        self.kinds.add(kind)
        if kind == "bilateral":
            return [vx.BilateralContact(on=side), *([self.tresca(side)] if free or self.chance(0.85) else [])]
        if kind == "unilateral":
            effects = [vx.UnilateralContact(on=side, gap=self.gap() if not free else 0.0)]
        else:
            stiffness = self.young / self.length * self._ten(-1, 3)
            effects = [vx.NormalCompliance(stiffness, on=side, gap=self.gap() if not free else 0.0)]
        friction = self.one("none", "tresca", "coulomb") if not free else self.one("tresca", "coulomb")
        if friction == "tresca":
            effects.append(self.tresca(side))
        if friction == "coulomb":
            effects.append(self.coulomb(side))
        return effects

    def contacts(self, held, free):
        """Return contact on one side, on two parts of a side, or on several sides that meet at corners."""
        names = self.built.boundaries
        kind = self.one("one", "one", "parts", "corner", "three")
        if kind == "parts" and "west" in names and "east" in names:
            self.kinds.add("parts")
            sides = ["west", "east"]
        elif kind in ("corner", "three"):
            self.kinds.add("corner")
            sides = ["bottom", "left"] if held != "left" else ["bottom", "right"]
            if kind == "three" and held != "right":
                sides.append("right")
        else:
            sides = ["bottom"]
        return [e for side in sides for e in self.contact(side, free)]

    def supports(self, held):
        move = self.length * self.strain
        kind = self.one("clamp", "clamp", "clamp", "moved", "moved", "normal", "tangent", "springs", "symmetry", "skew")
        self.kinds.add(kind)
        f, g, course = self.field(move, -1, 1), self.field(move, -1, 1), self.course()
        if kind == "clamp":
            return [vx.Clamp(on=held)]
        if kind == "moved":
            return [vx.PrescribedDisplacement(lambda x, t: course(t) * np.column_stack([f(x), g(x)]), on=held)]
        if kind in ("normal", "tangent"):
            k = self.young / self.length
            rest = [] if self.chance(0.5) else [vx.ElasticFoundation(k, k, on=held)]
            return [vx.PrescribedDisplacement(lambda x, t: course(t) * f(x), on=held, direction=kind), *rest]
        if kind == "skew":
            way = self.rng.uniform(-1, 1, 2)
            return [vx.PrescribedDisplacement(lambda x, t: course(t) * f(x), on=held, direction=tuple(way))]
        if kind == "symmetry":
            return [vx.Symmetry(on=held)]
        k = self.young / self.length * self._ten(-3, 1)
        return [vx.ElasticFoundation(k, k * self.one(0.0, 1.0, 0.3), on=held)]

    def weight(self, side, share=1.0):
        course, f = self.pressing(), self.field(self.young * self.strain * share, 0.5, 1.0)
        return vx.Pressure(lambda x, t: course(t) * f(x), on=side)

    # The run

    def solver(self, conic):
        kind = self.one("newton", "newton", "newton", "default", *(["clarabel", "osqp"] if conic else ["newton"]))
        if kind == "default":
            return None
        if kind == "newton":
            return vx.Newton(accuracy=float(f"{self._ten(-10, -2):.1e}"))
        self.kinds.add(kind)
        accuracy, polish = float(f"{self._ten(-6, -2):.1e}"), self.chance(0.3)
        return (vx.Clarabel if kind == "clarabel" else vx.OSQP)(accuracy=accuracy, polish=polish)


def draw(seed):
    """Return the scene of a seed.

    ``Drawn.kinds`` has some of these kinds: "bilateral", "unilateral", "soft", "Coulomb", "capped", "free",
    "kernel", "viscous", "heat", "prestress", "orthotropic", "two materials", "contrast", "incompressible", "thin",
    "turned", "parts", "corner", "gap moves", "belt", "extreme loads", "clarabel", "osqp", "iterative", "full", and the
    kind of support.
    """
    d = _Draw(seed)
    mesh = d.mesh()
    start = d.one(*["zero"] * 6, *["settled"] * 3, "equilibrium", *["given"] * 2, *["resumed"] * 2)
    d.late = start in ("settled", "equilibrium")
    effects = d.materials()
    free = d.chance(0.15)
    if free:
        d.kinds.add("free")
        effects += d.contacts("top", True)
        effects += [d.weight("top"), d.traction(d.one("left", "top"), d.young * d.strain * d._ten(-3, -1))]
    else:
        held = d.one("right", "right", "top", "left")
        effects += d.supports(held)
        if d.chance(0.93):
            effects += d.contacts(held, False)
        loose = bool(d.kinds & {"normal", "tangent", "springs", "symmetry", "skew"})
        effects += [d.traction(d.one(*SIDES), d.young * d.strain * (0.2 if loose else 1.0))]
        if d.chance(0.6):
            effects.append(d.weight("top", d._ten(-1, 0.5)))
        if not loose:
            effects += [d.force() for _ in range(int(d.rng.integers(0, 3)))]
    if d.chance(0.12):
        d.kinds.add("viscous")
        eta = d.young * d.period * d._ten(-2, 2)
        effects.append(vx.Viscosity(eta, eta * d.one(0.0, 1.0)))
    order = d.rng.permutation(len(effects))
    linear, condense = None, not d.chance(0.2)
    if not condense:
        d.kinds.add("full")
    if d.chance(0.08):
        d.kinds.add("iterative")
        linear = vx.Iterative()
    solver = d.solver(conic=d.chance(0.25))
    effects = [effects[i] for i in order]
    if _has_kernel(effects, mesh):
        d.kinds.add("kernel")
        if not d.chance(0.1):
            # If no support holds the body, iterative solvers and starts in equilibrium are refused.
            start, linear = "settled" if start == "equilibrium" else start, None
    return Drawn(seed, effects, mesh, d.times, solver, linear, condense, start, d.kinds)


def draw_two_bodies(seed):
    """Return a scene in which a second body replaces the ground, or None. The interface is named "bottom"."""
    drawn = draw(seed)
    if drawn.kinds & {"turned", "thin", "contrast"}:
        return None
    upper, n = drawn.mesh, 1 + seed % 4
    (x0, y0), (x1, y1) = upper.points.min(axis=0), upper.points.max(axis=0)
    sides = {side: upper.boundaries[side] for side in SIDES}
    upper = vx.PolygonMesh(upper.points, list(upper.cells), boundaries=sides, cell_data=upper.cell_data)
    lower = vx.meshes.squares((n, 1), box=((x0, x1), (2 * y0 - y1, y0)))
    lower = lower.with_cell_data("hard", np.ones(n)).with_cell_data("soft", np.zeros(n))
    mesh = vx.meshes.bodies({"lower": lower, "upper": upper}, interfaces={"bottom": ("lower", "upper")})
    for side in (name for name in SIDES if name != "bottom"):
        mesh = mesh.with_boundary(side, lambda x: np.full(len(x), True), of=f"upper.{side}")
    effects = [vx.Clamp(on="lower.bottom")]
    for effect in drawn.effects:
        on = getattr(effect, "on", None)
        if on in ("bottom", "west"):  # No traction and no moving ground act on an interface.
            effect = replace(effect, on="top" if isinstance(effect, vx.Traction) else "bottom")
            effect = replace(effect, ground=None) if getattr(effect, "ground", None) else effect
        effects += [effect] if on != "east" else []
    return replace(drawn, effects=effects, mesh=mesh)


def _has_kernel(effects, mesh):
    """Return True if only friction and one-sided contact hold the body."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vx.SceneWarning)
        try:
            return pose_scene(vx.Scene(*effects), mesh).system.kernel is not None
        except vx.VemcvxError:
            return False


def _midpoints(mesh, name):
    return mesh.points[mesh.boundaries[name]].mean(axis=1)
