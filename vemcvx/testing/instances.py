"""Small problems on which solvers are tested: every kind of term, alone and together, under a load that reverses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats
from vemcvx.effects import (
    BilateralContact,
    Clamp,
    Effect,
    Elasticity,
    NormalCompliance,
    Traction,
    TrescaFriction,
    UnilateralContact,
)
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES
from vemcvx.program import Limits, Norms, System
from vemcvx.program.condensation import Condensation
from vemcvx.scene import Scene
from vemcvx.scene.pose import pose_scene

TIMES: Floats = np.linspace(0.0, 1.0, 6)


@dataclass(frozen=True)
class Instance:
    """A problem: a system in time, made when it is first asked for."""

    name: str
    make: Callable[[], System]

    @cached_property
    def system(self) -> System:
        """The system; its instants are TIMES."""
        return self.make()

    @cached_property
    def features(self) -> frozenset[str]:
        """What its programs have."""
        return Condensation(self.system).operators.features


def _block(*below: Effect) -> Callable[[], System]:
    """The paper's block, held on the right, pulled to and fro on the left, on what is below."""

    def pull(x: Floats, t: float) -> Floats:
        course = np.sin(6 * t)
        return np.column_stack([8 * (1.25 - x[:, 1]) * course, np.full(len(x), -0.5 * course)])

    def make() -> System:
        scene = Scene(Elasticity(200.0, 0.3), Clamp(on="right"), Traction(pull, on="left"), *below)
        return pose_scene(scene, FAMILIES["squares"](4), TIMES.tolist()).system

    return make


def _cube(*below: Effect) -> Callable[[], System]:
    """A block in space, held on the right, on what is below; what pulls at its top goes round, and presses."""

    def pull(x: Floats, t: float) -> Floats:
        size = min(1.0, 4 * t)
        return np.tile(size * np.array([np.cos(6 * t), np.sin(6 * t), -0.6]), (len(x), 1))

    def make() -> System:
        scene = Scene(Elasticity(2.5, 0.25), Clamp(on="right"), Traction(pull, on="top"), *below)
        return pose_scene(scene, SPACE_FAMILIES["cubes"](2), TIMES.tolist()).system

    return make


def sliders(block: int, n: int = 6) -> System:
    """Unconnected sliders of different stiffness and threshold."""
    rng = np.random.default_rng(0)
    k, w = rng.uniform(1, 3, n), rng.uniform(0.2, 1.5, n)
    push = rng.uniform(-1, 1, (n, block))
    push /= np.linalg.norm(push, axis=1)[:, None]

    def load(t: float) -> Floats:
        return np.ravel(2 * np.sin(5 * t) * push)

    return System(_sparse(np.diag(np.repeat(k, block))), load, Norms(_sparse(np.eye(n * block)), w, block=block))


def _plain_matrices() -> System:
    """Three unknowns; rows of B and D that read several of them."""
    K = _sparse([[4.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 5.0]])
    norms = Norms(_sparse([[1.0, -1.0, 0.0], [0.0, 0.6, 0.8]]), [0.3, 0.5])
    limits = Limits(_sparse([[1.0, 1.0, 0.0]]), [0.4])
    return System(K, lambda t: [3 * t, -t, 2 * t * (1 - t)], norms, limits=limits)


def _sparse(rows: ArrayLike) -> sp.csr_matrix:
    return sp.csr_matrix(np.asarray(rows, dtype=float))


INSTANCES = {
    name: Instance(name, make)
    for name, make in {
        "no terms": _block(),
        "friction": _block(BilateralContact(on="bottom"), TrescaFriction(4.0, on="bottom")),
        "contact": _block(UnilateralContact(on="bottom", gap=1e-4)),
        "contact and friction": _block(UnilateralContact(on="bottom"), TrescaFriction(1.0, on="bottom")),
        "compliant contact": _block(NormalCompliance(1e3, on="bottom"), TrescaFriction(1.0, on="bottom")),
        "friction of one component": lambda: sliders(1),
        "friction of two components": lambda: sliders(2),
        "friction in space": _cube(BilateralContact(on="bottom"), TrescaFriction(0.6, on="bottom")),
        "contact and friction in space": _cube(UnilateralContact(on="bottom"), TrescaFriction(0.5, on="bottom")),
        "plain matrices": _plain_matrices,
    }.items()
}
"""By name; between them they have every feature of programs."""
