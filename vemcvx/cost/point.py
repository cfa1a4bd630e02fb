"""One setting of a sweep: mesh, steps, solver and accuracy, or the target of an adaptive run."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from vemcvx.meshes import PolygonMesh
from vemcvx.scene import Scene
from vemcvx.solvers import Solver

Floats = NDArray[np.float64]

FACTOR = 200
"""Assembling and factorising cost as much as so many steps, on the paper's scene with 33,000 unknowns."""
ADAPTIVE = 3.0
"""Unknowns of an adaptive run times target^2, and its steps times target: 3 and 1 on the paper's scene."""


@dataclass(frozen=True)
class Point:
    """Settings of one run.

    Attributes
    ----------
    family : str or None
        Of meshes; None is the problem's own.
    n : int
        Cells per unit length; of an adaptive run to begin with.
    steps : int or None
        None where the run chooses its own.
    solver : str
    accuracy : float
        Certified relative energy error of a step.
    target : float or None
        Relative energy error that an adaptive run aims at.
    """

    family: str | None
    n: int
    steps: int | None
    solver: str
    accuracy: float
    target: float | None = None

    def key(self, mark: str) -> str:
        """What identifies it among all runs of all problems; `mark` says what else the answer depends on."""
        words = json.dumps([asdict(self), mark], sort_keys=True)
        return hashlib.sha256(words.encode()).hexdigest()[:16]

    @property
    def work(self) -> float:
        """Unknowns times steps, roughly: for the order of runs and the time left, and nothing else."""
        if self.target is not None:
            return 2.0 * ADAPTIVE / self.target**2 * (FACTOR + 1.0 / self.target)
        unknowns = (4.0 if self.family == "voronoi" else 2.0) * self.n**2
        return unknowns * (FACTOR + (self.steps or 0))


@dataclass(frozen=True, eq=False)
class Ingredients:
    """What `simulate` takes, for one point."""

    scene: Scene
    mesh: PolygonMesh
    times: Floats
    solver: Solver
    initial: object = None


class Recipe(Protocol):
    """How a problem makes the ingredients of a point; it is sent to other processes by pickle."""

    @property
    def mark(self) -> str:
        """What identifies the problem: two recipes with one mark make the same ingredients."""

    def __call__(self, point: Point) -> Ingredients:
        """The ingredients of a point, of two steps if it has none."""
