"""Random scenes and their stored answers, computed by an earlier commit.

``draw(seed)`` returns a scene on a small mesh with its instants and its start. Every seed has its own random generator,
and draws use public names of vemcvx only, so that scenes stay the same while the package changes. Scenes cover the
plane and (one in seven) space; materials of all kinds and units; all supports; two bodies with an interface; bodies
held by friction and contact alone; unilateral, compliant and bilateral contact, gaps that move, contact on two sides;
Tresca's, Coulomb's, slip-weakening and anisotropic friction, moving ground; loads that reverse, stay constant and
vanish; dashpots; starts from zero and from a settled state.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import frozen_answers
import numpy as np
from scenes import moved, rotation

import vemcvx as vx
from vemcvx.effects import Contribution, Friction, Law

TAG = 56
"""Second number of each seed, so that these scenes and other random scenes have different random numbers."""
COUNT = 2000
ANSWERS = Path(__file__).with_name("frozen_scenes.npz")
FAMILIES = ("squares", "triangles", "hexagons", "voronoi", "distorted", "nonconvex", "hanging")
SPACE_FAMILIES = ("cubes", "cubes", "tetrahedra", "prisms", "voronoi3")


@dataclass
class FrozenScene:
    """A scene, its mesh, its instants, its initial state, and the kinds of its effects and settings."""

    seed: int
    effects: list
    mesh: vx.PolygonMesh | vx.PolyhedralMesh
    times: np.ndarray
    start: str | None
    kinds: set

    @property
    def is_ambiguous(self):
        """True if a step may have several solutions, because friction depends on pressure, slip or closure."""
        return bool(self.kinds & {"Coulomb", "weakening", "while closed"})

    @property
    def passes_on(self):
        """True if a step may enlarge the error of the step before, as explained in frozen_answers."""
        return self.is_ambiguous or bool(self.kinds & {"unilateral", "compliant"})

    def run(self, **options):
        """Simulate the scene."""
        return vx.simulate(vx.Scene(*self.effects), self.mesh, self.times, initial=self.start, **options)


@dataclass(frozen=True)
class SlipWeakening(vx.Effect):
    """Friction whose bound falls from `peak` to a third of it, by `softening` times the accumulated slip."""

    peak: float
    softening: float
    on: str

    def contribute(self, space):
        rows = space.part(self.on, "SlipWeakening", contact=True).node_normals

        def weights(t, p, past, slip):
            return rows.lengths * np.maximum(self.peak - self.softening * (past + slip), self.peak / 3)

        law = Law(weights, softening=self.softening * rows.lengths)
        return Contribution(frictions=(replace(Friction.from_rows(rows, "SlipWeakening"), law=law),))

    def describe(self):
        return f"SlipWeakening: bound from {self.peak:.3g}, falling by {self.softening:.3g} per slip, on {self.on}"


@dataclass
class _Draw:
    """The random choices that make one scene."""

    seed: int
    kinds: set = field(default_factory=set)

    def __post_init__(self):
        self.rng = np.random.default_rng([self.seed, TAG])
        self.length, self.young, self.strain = self.ten(-2, 2), self.ten(-2, 6), self.ten(-5, -2)
        self.stress, self.move = self.young * self.strain, self.length * self.strain
        self.period = self.ten(-1, 2)
        gaps = 10 ** self.rng.uniform(-1, 0, int(self.rng.integers(1, 6)))
        self.times = self.period * np.append(0.0, np.cumsum(gaps))
        self.start = self.one(None, None, "settled")

    def chance(self, p):
        return self.rng.random() < p

    def one(self, *things):
        return things[int(self.rng.integers(len(things)))]

    def note(self, kind):
        """Record a kind of effect and return it."""
        self.kinds.add(kind)
        return kind

    def ten(self, low, high):
        return float(10.0 ** self.rng.uniform(low, high))

    # Space

    def block(self, box, n):
        """Return a mesh of a box."""
        if len(box) == 3:
            family = self.one(*SPACE_FAMILIES)
            return vx.meshes.SPACE_FAMILIES[family]((2, 2, n), box=box, seed=self.seed % 50)
        return vx.meshes.FAMILIES[self.one(*FAMILIES)]((int(self.rng.integers(2, 4)), n), box=box)

    def make_mesh(self):
        """Return a mesh of one block, or of two blocks on each other, in the plane or in space."""
        self.dim = 3 if self.chance(0.15) else 2
        self.plane = self.one("strain", "strain", "stress")
        self.kinds.add("space" if self.dim == 3 else f"plane {self.plane}")
        box = [(0.0, self.length * w) for w in 10 ** self.rng.uniform(-0.3, 0.3, self.dim)]
        self.two_bodies = self.chance(0.2)
        if self.two_bodies:
            self.kinds.add("interface")
            half = 0.5 * box[-1][1]
            parts = {"lower": (0.0, half), "upper": (half, 2 * half)}
            mesh = vx.meshes.bodies({name: self.block([*box[:-1], z], 1) for name, z in parts.items()})
            self.sides = {side: f"upper.{side}" for side in ("left", "right", "top")} | {"bottom": "lower.bottom"}
        else:
            mesh = self.block(box, 2)
            mesh = moved(mesh, rotation(self.rng.uniform(-3, 3))) if self.dim == 2 and self.chance(0.15) else mesh
            self.sides = {side: side for side in ("left", "right", "top", "bottom")}
        hard = self.rng.random(mesh.n_cells) < 0.5
        self.two_materials = self.chance(0.1) and hard.any() and not hard.all()
        self.mesh = mesh.with_cell_data("hard", hard.astype(float)).with_cell_data("soft", (~hard).astype(float))

    def field(self, size, low=0.0, high=1.0):
        """Return an affine function of place with values between low and high times a size."""
        origin, span = self.mesh.points.min(axis=0), np.ptp(self.mesh.points, axis=0)
        c = self.rng.uniform(low, high, 1 + self.dim)
        return lambda x: size * (c[0] + ((x - origin) / span) @ (c[1:] - c[0]) / self.dim)

    def vector(self, size):
        """Return an affine vector field times a course in time, f(x, t)."""
        parts, course = [self.field(size, -1, 1) for _ in range(self.dim)], self.course()
        return lambda x, t: course(t) * np.column_stack([part(x) for part in parts])

    # Time

    def course(self, low=-1.0):
        """Return a factor in time: a ramp, random values from `low` to 1, a reversal, a pause or a drop to zero."""
        n, kind = len(self.times), self.one("ramp", "random", "turn", "hold", "drop")
        values = {
            "ramp": np.linspace(0, 1, n),
            "random": self.rng.uniform(low, 1, n),
            "turn": np.sin(np.linspace(0, self.rng.uniform(2, 7), n)) if low < 0 else self.rng.uniform(0.4, 1, n),
            "hold": np.ones(n),
            "drop": self.rng.choice([0.0, 1.0, low], n),
        }[kind]
        if self.start is None:
            values[0] = 0.0
        return lambda t: float(np.interp(t, self.times, values))

    # Physics

    def material(self, factor=1.0, on=None):
        E, plane = self.young * factor, {} if self.dim == 3 else {"plane": self.plane}
        if self.chance(0.15):
            self.kinds.add("orthotropic")
            young = [E, *(E * part for part in 10 ** self.rng.uniform(-1, 0, 2))]
            G = [E * g for g in 10 ** self.rng.uniform(-1.2, -0.3, 3)]
            shear, angle = G[0] if self.dim == 2 else tuple(G), self.rng.uniform(-2, 2)
            if plane == {"plane": "stress"}:
                return vx.Orthotropic(tuple(young[:2]), 0.2, shear, angle, on=on, **plane)
            return vx.Orthotropic(tuple(young), (0.2, 0.1, 0.1), shear, angle, on=on, **plane)
        if self.chance(0.1) and on is None:
            self.kinds.add("contrast")
            E = E * 10 ** self.rng.uniform(-2, 2, self.mesh.n_cells)
        poisson = self.one(0.3, 0.3, 0.0, self.rng.uniform(-0.5, 0.45))
        return vx.Elasticity(E, poisson, on=on, stabilisation=self.one("shear", "shear", "shear", "unit"), **plane)

    def materials(self):
        if self.two_materials:
            self.kinds.add("two materials")
            return [self.material(self.ten(-2, 2), "hard"), self.material(1.0, "soft")]
        return [self.material()]

    def load(self):
        """Return a load of a random kind, in proportion to the stiffness."""
        kind = self.note(self.one("traction", "traction", "pressure", "body force", "point load", "heat", "prestress"))
        course, f, side = self.course(), self.field(self.stress, -1, 1), self.sides[self.one("left", "right", "top")]
        if kind == "traction":
            return vx.Traction(self.vector(self.stress), on=side)
        if kind == "pressure":
            return vx.Pressure(lambda x, t: course(t) * f(x), on=side)
        if kind == "body force":
            return vx.BodyForce(self.vector(self.stress / self.length))
        if kind == "point load":
            push = self.stress * self.length ** (self.dim - 1) * self.rng.uniform(-0.5, 0.5, self.dim)
            top = self.mesh.points[int(np.argmax(self.mesh.points.sum(axis=1)))]
            return vx.PointLoad(lambda x, t: course(t) * np.tile(push, (len(x), 1)), at=top)
        if kind == "heat":
            return vx.ThermalStrain(self.strain, lambda x, t: course(t) * f(x) / self.stress)
        parts = [self.field(self.stress, -1, 1) for _ in range(3 if self.dim == 2 else 6)]
        return vx.Prestress(lambda x, t: course(t) * np.column_stack([part(x) for part in parts]))

    def supports(self):
        """Return the supports of the upper or only body, on one side."""
        side = self.sides[self.one("right", "right", "top", "left")]
        kind = self.note(self.one("clamp", "clamp", "moved", "moved", "normal", "springs", "symmetry", "skew"))
        course, f, k = self.course(), self.field(self.move, -1, 1), self.young / self.length
        springs = vx.ElasticFoundation(k * self.ten(-2, 1), k * self.ten(-2, 1), on=side)
        if kind == "clamp":
            return [vx.Clamp(on=side)]
        if kind == "moved":
            return [vx.PrescribedDisplacement(self.vector(self.move), on=side)]
        if kind == "springs":
            return [springs]
        if kind == "symmetry":
            return [vx.Symmetry(on=side), springs]
        way = "normal" if kind == "normal" else tuple(self.rng.uniform(0.2, 1, self.dim))
        return [vx.PrescribedDisplacement(lambda x, t: course(t) * f(x), on=side, direction=way), springs]

    def bound(self):
        """Return a friction bound: constant, varying in space or in time, zero in places, zero or huge."""
        size, f, course = self.stress * self.ten(-1.5, 0.3), self.field(1.0), self.course(0.0)
        return self.one(
            size,
            size,
            lambda x, t: size * f(x),
            lambda x, t: np.full(len(x), size * (0.2 + course(t))),
            lambda x, t: size * np.maximum(f(x) - 0.4, 0.0),
            0.0,
            1e3 * size,
        )

    def by_direction(self):
        """Return a direction of anisotropic friction, and the ratio of the bound across to the bound along it."""
        angle = self.rng.uniform(0, 3)
        return (float(np.cos(angle)), float(np.sin(angle)), 0.1), self.rng.uniform(0.3, 1.5)

    def friction(self, side, pressed, law=None):
        """Return friction on a side; `pressed` is False in bilateral contact."""
        kinds = ("Tresca", "Tresca", "weakening", *(["Coulomb", "Coulomb", "Coulomb"] if pressed else []))
        kind, options = self.note(law or self.one(*kinds)), {}
        if kind == "weakening":
            return SlipWeakening(self.stress * self.ten(-1, 0.3), 0.05 * self.young / self.length, side)
        if "|" not in side and self.chance(0.2):
            self.kinds.add("moving ground")
            way, course = self.move * self.rng.uniform(-3, 3, self.dim), self.course()
            options["ground"] = lambda x, t: np.tile(course(t) * way, (len(x), 1))
        direction, ratio = self.by_direction() if self.dim == 3 and self.chance(0.3) else (None, None)
        if direction is not None:
            self.kinds.add("by direction")
        if kind == "Tresca":
            bound = self.bound()
            if direction is not None and not callable(bound):
                options |= {"direction": direction, "across": ratio * bound}
            elif pressed and self.chance(0.15):
                options["while_closed"] = self.note("while closed") is not None
            return vx.TrescaFriction(bound, on=side, quadrature=self.one("nodes", "nodes", "integral"), **options)
        mu = self.rng.uniform(0.02, 0.4)
        if direction is not None:
            return vx.CoulombFriction(mu, on=side, direction=direction, across=ratio * mu, **options)
        if self.chance(0.15):
            self.kinds.add("cap")
            options["cap"] = self.stress * self.ten(-1, 0)
        f = self.field(mu, 0.5, 1.0)
        return vx.CoulombFriction(mu if self.chance(0.6) else lambda x, t: f(x), on=side, **options)

    def gap(self):
        course, f = self.course(), self.field(0.5 * self.move)
        kind = self.note(self.one("no gap", "no gap", "constant gap", "varying gap", "moving gap"))
        return {
            "no gap": 0.0,
            "constant gap": self.move * self.ten(-2, 0),
            "varying gap": lambda x, t: f(x),
            "moving gap": lambda x, t: np.full(len(x), 0.3 * self.move * abs(course(t))),
        }[kind]

    def contact(self, side, free=False):
        """Return contact on a side, mostly with friction; `free` bodies always have friction, and no gap."""
        kind = self.note(self.one("bilateral", "unilateral", "unilateral", "compliant"))
        gap = 0.0 if free else self.gap()
        if kind == "bilateral":
            effects = [vx.BilateralContact(on=side)]
        elif kind == "unilateral":
            effects = [vx.UnilateralContact(on=side, gap=gap)]
        else:
            effects = [vx.NormalCompliance(self.young / self.length * self.ten(0, 2), on=side, gap=gap)]
        rubs = free or self.chance(0.8)
        return [*effects, *([self.friction(side, kind != "bilateral")] if rubs else [])]

    def weight(self):
        course, f = self.course(0.1), self.field(self.stress, 0.5, 1.0)
        return vx.Pressure(lambda x, t: course(t) * f(x), on=self.sides["top"])

    def scene(self):
        self.make_mesh()
        effects, free = self.materials(), self.chance(0.12)
        if free:
            self.kinds.add("free")
            small = self.stress * self.ten(-3, -1)
            effects += [self.weight(), vx.Traction(self.vector(small), on=self.sides["left"])]
        else:
            effects += self.supports() + [self.load() for _ in range(int(self.rng.integers(1, 3)))]
            effects += [self.weight()] if self.chance(0.6) else []
        if self.two_bodies:
            effects += [vx.Clamp(on="lower.bottom"), *self.contact("lower|upper", free)]
        elif free or self.chance(0.95):
            effects += self.contact("bottom", free)
            if not free and self.chance(0.08):
                self.kinds.add("two sides")
                effects += self.contact("left")
        if self.chance(0.12):
            self.kinds.add("viscous")
            eta = self.young * self.period * self.ten(-2, 1)
            effects.append(vx.Viscosity(eta, eta * self.one(0.0, 1.0)))
        return effects


def draw(seed):
    """Return the scene of a seed."""
    d = _Draw(seed)
    effects = d.scene()
    return FrozenScene(seed, effects, d.mesh, d.times, d.start, d.kinds)


@dataclass
class Judgement:
    """Outcomes of scenes, by seed: differences in words, and refusals."""

    wrong: dict = field(default_factory=dict)
    """seed -> faults, where answers must agree"""
    other: dict = field(default_factory=dict)
    """seed -> faults, where a step may have several solutions"""
    refused: Counter = field(default_factory=Counter)
    """class of error -> number of scenes"""
    refused_before: Counter = field(default_factory=Counter)
    newly_refused: dict = field(default_factory=dict)
    """seed -> class and message"""
    messages: dict = field(default_factory=dict)
    """seed -> message of the error, for all refused scenes"""
    ratios: dict = field(default_factory=dict)
    """seed -> distance, relative to the allowed distance"""

    @property
    def crashed(self):
        """Errors of classes that the package does not define."""
        return {kind: count for kind, count in self.refused.items() if kind.startswith("crash")}


def judge(seeds, **options):
    """Simulate scenes, with options of vx.simulate, and compare them with the stored answers."""
    answers, judgement = frozen_answers.read(ANSWERS), Judgement()
    for seed in seeds:
        scene, old = draw(seed), answers[str(seed)]
        new, history = frozen_answers.answer(lambda scene=scene: scene.run(**options))
        judgement.refused_before.update([old.refused] if old.refused else [])
        if new.refused:
            judgement.refused[new.refused] += 1
            judgement.messages[seed] = new.message
        if new.refused and not old.refused:
            judgement.newly_refused[seed] = f"{new.refused}: {new.message}"
        elif not new.refused and not old.refused:
            compared = frozen_answers.compare(old, new, history, frozen_answers.GROWTH if scene.passes_on else 1.0)
            judgement.ratios[seed] = compared.ratio
            if compared.faults:
                words = f"{'; '.join(compared.faults)}; certified {old.certified:.1e} ({old.kind}), then "
                words += f"{new.certified:.1e} ({new.kind}); {sorted(scene.kinds)}"
                (judgement.other if scene.is_ambiguous else judgement.wrong)[seed] = words
    return judgement
