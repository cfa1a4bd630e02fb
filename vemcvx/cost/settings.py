"""Points and grids of a sweep: settings of one run, and all their combinations."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arrays import Floats
from vemcvx.errors import ProblemError
from vemcvx.estimate.adapt import Adapted, adapt
from vemcvx.history import History
from vemcvx.initial_displacement import Projected
from vemcvx.meshes import AnyMesh
from vemcvx.scene import Scene
from vemcvx.simulation import simulate
from vemcvx.solvers import Solver

FACTOR = 200  # Assembling and factorising cost as much as so many steps, on the paper's scene with 33,000 unknowns.


@dataclass(frozen=True)
class Point:
    """Settings of one run: those of :class:`vemcvx.cost.Row`.

    `family` is None for the problem's own, and `steps` where an adaptive run, which has a `target`, chooses them.
    Errors and targets are `of` the energy norm or of another quantity that :func:`vemcvx.adapt` aims at. Where it is
    `bounded` the guaranteed bound stands beside the estimate.
    """

    family: str | None
    n: int
    steps: int | None
    solver: str
    accuracy: float
    target: float | None = None
    of: str = "energy"
    bounded: bool = False

    def key(self, mark: str) -> str:
        """A key that identifies the point among all runs; `mark` names all else that the answer depends on."""
        words = json.dumps([asdict(self), mark], sort_keys=True)
        return hashlib.sha256(words.encode()).hexdigest()[:16]

    @property
    def work(self) -> float:
        """Unknowns times steps, roughly; only the order of runs is taken from it."""
        if self.target is not None:
            # An adaptive run has 3 / target^2 unknowns and 1 / target steps on the paper's scene.
            return 2.0 * 3.0 / self.target**2 * (FACTOR + 1.0 / self.target)
        unknowns = (4.0 if self.family == "voronoi" else 2.0) * self.n**2
        return unknowns * (FACTOR + (self.steps or 0))


@dataclass(frozen=True, eq=False)
class Ingredients:
    """The arguments of `simulate` and `adapt` for one point."""

    scene: Scene
    mesh: AnyMesh
    times: Floats
    solver: Solver
    initial: ArrayLike | str | Projected | None = None

    def simulated(self, **options: Any) -> History:
        """The history on this mesh and at these instants."""
        return simulate(self.scene, self.mesh, self.times, solver=self.solver, initial=self.initial, **options)

    def adapted(self, instants: Floats, target: float, **options: Any) -> Adapted:
        """The history on a mesh adapted from this one, which has these instants and the first."""
        wanted = np.append(self.times[0], instants)
        return adapt(self.scene, self.mesh, wanted, target, solver=self.solver, initial=self.initial, **options)


class Recipe(Protocol):
    """A recipe makes the ingredients of a point; it is sent to other processes by pickle."""

    @property
    def mark(self) -> str:
        """A mark that identifies the problem: two recipes with one mark make the same ingredients."""

    def __call__(self, point: Point) -> Ingredients:
        """The ingredients of a point, of two steps if it has none."""


OTHERS = ("clarabel", "osqp")


@dataclass(frozen=True)
class Grid:
    """The grid of a sweep: all combinations of its fields.

    Without `solvers` and `accuracies` Newton runs everywhere at 1e-8, and others at a few points. `targets` are those
    of adaptive runs, and the levels that advice is given for; they, and all errors, are `of` one quantity. `bounded`
    asks for guaranteed bounds beside estimates.
    """

    families: tuple[str | None, ...]
    ns: tuple[int, ...]
    steps: tuple[int, ...]
    solvers: tuple[str, ...] | None
    accuracies: tuple[float, ...] | None
    targets: tuple[float, ...]
    adaptive: bool = True
    of: str = "energy"
    bounded: bool = False

    @property
    def points(self) -> tuple[Point, ...]:
        """The points, those with most work first, so that at the end no worker waits long for another."""
        main = tuple(product(self.solvers or ("newton",), self.accuracies or (1e-8,)))
        found = [Point(f, n, k, *how) for f, n, k, how in product(self.families, self.ns, self.steps, main)]
        if self.adaptive:
            start, (solver, accuracy) = min(self.ns), (main[0][0], min(accuracy for _, accuracy in main))
            found += [
                Point(family=f, n=start, steps=None, solver=solver, accuracy=accuracy, target=t)
                for f, t in product(self.families, self.targets)
            ]
        if self.solvers is None and self.accuracies is None:
            where = sorted(self.ns)[1:-1:2] or self.ns[:1]
            # Without a choice of solvers Newton runs everywhere, and these on two meshes of the first family.
            chosen = product(where, self.steps[-1:], OTHERS, (1e-3, 1e-6))
            found += [Point(self.families[0], *settings) for settings in chosen]
        found = [replace(point, of=self.of, bounded=self.bounded) for point in found]
        return tuple(sorted(dict.fromkeys(found), key=lambda point: -point.work))

    @property
    def coarsest(self) -> Point:
        """The point whose mesh the reference is refined from."""
        return Point(self.families[0], min(self.ns), max(self.steps), "newton", 1e-8, of=self.of)

    @property
    def finest(self) -> Point:
        """The point that the reference has to beat where it cannot be adapted."""
        return Point(self.families[0], max(self.ns), max(self.steps), "newton", 1e-8, of=self.of)


def common_instants(courses: Sequence[Floats]) -> Floats:
    """Up to four instants that all courses of time have, evenly chosen, the last one among them."""
    first, *others = courses
    span = float(first[-1] - first[0])
    for other in others:
        if max(abs(other[0] - first[0]), abs(other[-1] - first[-1])) > 1e-9 * span:
            raise ProblemError(
                f"times({len(first) - 1}) runs from {first[0]:g} to {first[-1]:g}, times({len(other) - 1}) from "
                f"{other[0]:g} to {other[-1]:g}; a sweep compares answers at the end, so both must be the same."
            )
    shared = [t for t in first[1:] if all(np.abs(other - t).min() <= 1e-9 * span for other in others)]
    chosen = np.arange(1, 5) * len(shared) // 4 - 1
    return np.array(shared)[np.unique(chosen[chosen >= 0])]
