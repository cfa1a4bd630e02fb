"""Random meshes, materials, loads, bounds and systems, for hypothesis.

Hypothesis draws a few values and a seed. numpy draws large arrays from the seed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from hypothesis import strategies as st
from scenes import FAMILIES

import vemcvx as vx
from vemcvx.scene import pose_scene

SEEDS = st.integers(0, 10_000)
HUGE = 1e6


def exponents(low, high):
    """Draw powers of ten between 10^low and 10^high."""
    return st.floats(low, high).map(lambda x: float(10.0**x))


def for_all(**strategies):
    """Record the strategies from which the arguments of a test are drawn."""

    def note(claim):
        claim.strategies = strategies
        return claim

    return note


@st.composite
def meshes(draw):
    """Draw meshes of the unit square with a few cells."""
    family = draw(st.sampled_from(("voronoi",) * 4 + FAMILIES))
    return vx.meshes.FAMILIES[family](draw(st.integers(2, 5 if family == "voronoi" else 3)), seed=draw(SEEDS))


@st.composite
def materials(draw, mesh):
    """Draw an elastic material."""
    young, poisson = draw(exponents(-3, 6)), draw(st.floats(-0.9, 0.4999))
    # Linear triangles lock near incompressibility.
    poisson = min(poisson, 0.45) if (np.diff(mesh.offsets) == 3).any() else poisson
    contrast = draw(st.sampled_from((0.0, 0.0, 1.0, 3.0)))
    spread = 10.0 ** (contrast * np.random.default_rng(draw(SEEDS)).uniform(-1, 1, mesh.n_cells))
    plane = draw(st.sampled_from(("strain", "stress")))
    return vx.Elasticity(young * spread if contrast else young, poisson, plane=plane)


def courses(steps):
    """Draw values at the instants. The first value is 0."""
    # Tiny values are set to zero, because energy norms below 1e-125 are refused.
    free = st.lists(st.floats(-1, 1).map(lambda x: x if abs(x) > 1e-60 else 0.0), min_size=steps, max_size=steps)
    few = st.lists(st.sampled_from((0.0, 1.0, -1.0, 0.5, 1.0 + 1e-6)), min_size=steps, max_size=steps)
    return st.one_of(st.just(list(np.linspace(0, 1, steps + 1)[1:])), few, free).map(lambda c: np.array([0.0, *c]))


@st.composite
def instants(draw, most=4):
    """Draw increasing times from 0, with steps between 1e-3 and 1."""
    return np.append(0.0, np.cumsum(draw(st.lists(exponents(-3, 0), min_size=1, max_size=most))))


@st.composite
def bounds(draw, scale):
    """Draw friction bounds g(x, t)."""
    kind = draw(st.sampled_from(("constant", "varies", "zero in places", "jumps", "jumps in time", "zero", "huge")))
    size = scale * draw(exponents(-2, 0.5))
    shapes = {
        "constant": lambda x, t: np.ones(len(x)),
        "varies": lambda x, t: 0.1 + x[:, 0] ** 2 + x[:, 1],
        "zero in places": lambda x, t: np.maximum(x[:, 0] + x[:, 1] - 0.5, 0.0),
        "jumps": lambda x, t: np.where(x[:, 0] + x[:, 1] < 0.5, 0.01, 1.0),
        "jumps in time": lambda x, t: np.full(len(x), 1.0 if t < 0.5 else 0.2),
        "zero": lambda x, t: np.zeros(len(x)),
        "huge": lambda x, t: np.full(len(x), HUGE),
    }
    shape = shapes[kind]
    return lambda x, t: size * shape(x, t)


def affine(matrix, vector, times, course):
    """Return f(x, t) = (vector + matrix x) course(t)."""

    def value(x, t):
        return (vector + x @ matrix.T) * course[np.searchsorted(times, t)]

    return value


@dataclass(frozen=True)
class Setting:
    """A mesh, times, and the parts of a scene."""

    mesh: vx.PolygonMesh
    material: vx.Elasticity
    loads: tuple
    """Each load is (matrix, vector, course, side); `side` is None for a body force."""
    bound: object
    quadrature: str
    times: np.ndarray
    motion: tuple | None = None
    """The motion (matrix, vector, course) of the right side, or None if this side is clamped."""

    @property
    def scene(self):
        effects = []
        for matrix, vector, course, side in self.loads:
            force = affine(matrix, vector, self.times, course)
            effects.append(vx.BodyForce(force) if side is None else vx.Traction(force, on=side))
        held = vx.Clamp(on="right")
        if self.motion is not None:
            matrix, vector, course = self.motion
            held = vx.PrescribedDisplacement(affine(matrix, vector, self.times, course), on="right")
        friction = vx.TrescaFriction(self.bound, on="bottom", quadrature=self.quadrature)
        return vx.Scene(self.material, held, vx.BilateralContact(on="bottom"), friction, *effects)


@st.composite
def settings_of_scenes(draw, moving=False, most_steps=4):
    """Draw settings with affine loads and random friction bounds."""
    mesh, times = draw(meshes()), draw(instants(most_steps))
    steps, rng = len(times) - 1, np.random.default_rng(draw(SEEDS))
    size = draw(exponents(-3, 3))
    sides = draw(st.sampled_from((("left",), ("left", "top"), ("left", None))))
    loads = tuple(
        (size * rng.normal(size=(2, 2)), size * rng.normal(size=2), draw(courses(steps)), side) for side in sides
    )
    material, motion = draw(materials(mesh)), None
    if moving and draw(st.booleans()):
        strain = size / np.min(material.young)
        motion = strain * rng.normal(size=(2, 2)), strain * rng.normal(size=2), draw(courses(steps))
    quadrature = draw(st.sampled_from(("nodes", "integral")))
    return Setting(mesh, material, loads, draw(bounds(size)), quadrature, times, motion)


@dataclass(frozen=True)
class Case:
    """A quasistatic problem as arrays. Loads and weights have single precision, so that scaling is exact."""

    K: np.ndarray
    B: sp.csr_matrix
    block: int
    loads: np.ndarray
    """loads (instants, unknowns)"""
    weights: np.ndarray
    """weights (instants, terms)"""
    times: np.ndarray

    def __post_init__(self):
        for name in ("loads", "weights"):
            object.__setattr__(self, name, getattr(self, name).astype(np.float32).astype(float))

    def times_forces(self, c):
        """Return the case with all forces multiplied by c."""
        scaled = replace(self)
        object.__setattr__(scaled, "loads", c * self.loads)
        object.__setattr__(scaled, "weights", c * self.weights)
        return scaled

    def march(self, solver, check=True):
        """Return the trajectory from the state zero."""

        def row(t):
            return int(np.searchsorted(self.times, t))

        norms = vx.Norms(self.B, lambda t: self.weights[row(t)], self.block)
        system = vx.System(sp.csr_matrix(self.K), lambda t: self.loads[row(t)], norms)
        return vx.march(system, self.times, solver=solver, check=check)


@st.composite
def abstract_cases(draw, blocks=(1, 2)):
    """Draw cases with random matrices K and B."""
    block, rng = draw(st.sampled_from(blocks)), np.random.default_rng(draw(SEEDS))
    m = draw(st.integers(1, 4))
    n = draw(st.integers(m * block, 10))
    basis = np.linalg.qr(rng.normal(size=(n, n)))[0]
    K = basis * 10.0 ** (rng.uniform(0, draw(st.floats(0, 6)), n)) @ basis.T * draw(exponents(-4, 4))
    B = rng.normal(size=(m * block, n))
    if draw(st.booleans()):
        B = np.zeros_like(B)
        B[np.arange(m * block), rng.permutation(n)[: m * block]] = rng.choice([-1.0, 2.0], m * block)
    times = draw(instants())
    fields, size = rng.normal(size=(2, n)), draw(exponents(-3, 3))
    loads = size * sum(np.outer(draw(courses(len(times) - 1)), field) for field in fields)
    weights = size * draw(exponents(-2, 1)) * rng.uniform(0, 1, m) * np.ones((len(times), 1))
    weights[:, rng.random(m) < draw(st.sampled_from((0.0, 0.3)))] = 0.0
    weights[:, rng.random(m) < draw(st.sampled_from((0.0, 0.3)))] *= HUGE
    weights[len(times) // 2 :] *= draw(st.sampled_from((1.0, 0.3, 3.0)))
    return Case(0.5 * (K + K.T), sp.csr_matrix(B), block, loads, weights, times)


@st.composite
def scene_cases(draw):
    """Draw random scenes as arrays."""
    setting = draw(settings_of_scenes())
    system, times = pose_scene(setting.scene, setting.mesh).system, setting.times
    loads, weights = (np.array([f(t) for t in times]) for f in (system.force, system.norms.weights))
    return Case(system.K.toarray(), system.norms.B, system.norms.block, loads, weights, times)


def cases(blocks=(1, 2)):
    """Draw random problems, from scenes and from matrices."""
    return st.one_of(abstract_cases(blocks), scene_cases())
