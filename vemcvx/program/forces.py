"""Forces and what they do, as combinations of a few shapes that are solved for.

A load that keeps its shape, or changes between a few, has the responses of these shapes, and products phi'x of
combinations are those of the shapes. A step then works with as many numbers as there are shapes, and with vectors of
all unknowns only where somebody asks for them. Shapes are orthogonalised as they come, on the unknowns that any force
has loaded; what of a force is rounding beside the shapes seen before is dropped, and only the rest is solved for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from vemcvx.arrays import EPS, Floats, Ints, power_of_two

SAME_FIELD = 8 * EPS
"""Residuals of a load on the shapes solved for below this times the load are rounding, and are dropped. A shape that
was a small part of a load carries that load's rounding, and a combination with large shares amplifies it: at most 8
times a load's own rounding is dropped; a load that turns in space left 1.4."""
MOST_FIELDS = 6
"""Beyond this many, a load that keeps changing its shape is solved for afresh, step by step."""


@dataclass(frozen=True)
class ForceOnPart:
    """A force that acts on some of n unknowns alone: their numbers `rows`, ascending, and t -> the forces there."""

    n: int
    rows: Ints
    entries: Callable[[float], Floats]

    def __call__(self, t: float) -> Floats:
        """All forces (n,)."""
        return spread(self.entries(t), self.rows, self.n)


def on_part(force: Callable[[float], Floats], t: float) -> tuple[Floats, Ints | None]:
    """A force at the instant `t`, and the unknowns that it acts on; None for all of them."""
    return (force.entries(t), force.rows) if isinstance(force, ForceOnPart) else (force(t), None)


@dataclass(frozen=True, eq=False)
class SolvedForce:
    """A force, its unit taken off, that was solved for.

    Attributes
    ----------
    phi, z : (n,) arrays
        The force, and the first half of a solve (:class:`vemcvx.linear.Halves`): what it does inside.
    retained, released : (m,) arrays
        tau, the force that phi makes on the retained unknowns; how far it moves them if nothing holds them.
    number : int or None
        Which of those that are remembered; None if it is not.
    respond : callable () -> (n,)
        K^{-1} phi, which few ask for.
    product : callable
        phi'xi of two forces from their first halves.
    """

    phi: Floats
    z: Floats
    retained: Floats
    released: Floats
    number: int | None
    respond: Callable[[], Floats]
    product: Callable[[Floats, Floats], float]
    _products: dict[int, tuple[float, float]] = field(default_factory=dict, repr=False)

    @cached_property
    def x(self) -> Floats:
        """K^{-1} phi (n,)."""
        return self.respond()

    def products(self, other: SolvedForce) -> tuple[float, float]:
        """phi'x = phi'xi + tau'x_c and phi'xi, with the responses of another shape."""
        if self.number is not None and other.number in self._products:
            return self._products[other.number]
        inside = self.product(self.z, other.z)
        found = inside + float(self.retained @ other.released), inside
        if self.number is not None and other.number is not None:
            self._products[other.number] = found
        return found


Parts = dict[SolvedForce, float]


class Reduced:
    """A force phi (n,), and what it does.

    Parameters
    ----------
    phi : callable () -> (n,)
    parts : dict of SolvedForce to float
        The combination that the force is, but for rounding.
    retained : (m,) array
        tau, the force that it makes there.
    """

    def __init__(self, phi: Callable[[], Floats], parts: Parts, retained: Floats):
        self._phi, self.parts, self.retained = phi, parts, retained

    @cached_property
    def phi(self) -> Floats:
        """The force (n,)."""
        return self._phi()

    @cached_property
    def x(self) -> Floats:
        """Its response K^{-1} phi (n,)."""
        return combined([(share, one.x) for one, share in self.parts.items()], self.phi)

    @property
    def inner(self) -> Floats:
        """The first half of a solve (n,), what it does inside."""
        return combined([(share, one.z) for one, share in self.parts.items()], self.phi)

    @cached_property
    def norm(self) -> float:
        """(phi'K^{-1}phi)^{1/2}, the energy norm of what it causes."""
        largest = max(map(abs, self.parts.values()), default=0.0)
        if not 0 < largest < np.inf:
            return largest
        if any(one.number is None for one in self.parts):
            # Of parts that are not orthogonal the products may cancel.
            return largest * float(np.sqrt(abs((self.phi / largest) @ (self.x / largest))))
        shares = [(one, share / largest) for one, share in self.parts.items()]
        square = sum(a * b * one.products(two)[0] for one, a in shares for two, b in shares)
        return largest * float(np.sqrt(abs(square)))

    def work_inside(self, other: Reduced) -> float:
        """phi'xi, the work on what another force does inside."""
        pairs = ((one, a, two, b) for one, a in self.parts.items() for two, b in other.parts.items())
        # Each share carries the unit of its force: the product of two may be no number where that of all three is.
        return float(sum(a * (b * one.products(two)[1]) for one, a, two, b in pairs))

    def same(self, other: Reduced) -> bool:
        """Return True if the forces are equal; most that are not differ by far more than rounding in what they do."""
        apart = np.abs(self.retained - other.retained).max(initial=0.0)
        near = apart <= 1e-6 * np.abs(self.retained).max(initial=0.0)
        return bool(near) and np.array_equal(self.phi, other.phi)

    def __add__(self, other: Reduced) -> Reduced:
        return self._and(other, 1.0)

    def __sub__(self, other: Reduced) -> Reduced:
        return self._and(other, -1.0)

    def _and(self, other: Reduced, sign: float) -> Reduced:
        one, two = self.parts, other.parts
        parts = {shape: one.get(shape, 0.0) + sign * two.get(shape, 0.0) for shape in {**one, **two}}
        return Reduced(lambda: self.phi + sign * other.phi, parts, self.retained + sign * other.retained)


def combined(shares: Sequence[tuple[float, Floats]], like: Floats) -> Floats:
    """The sum of shares of arrays; zeros like another if there are none."""
    total = np.zeros_like(like)
    with np.errstate(over="ignore", invalid="ignore"):
        for share, array in shares:
            total += share * array
    return total


class SolvedForces:
    """Shapes of forces seen so far, on the unknowns that any of them loads.

    Parameters
    ----------
    n : int
    solve : callable (force (n,), number) -> SolvedForce
    ease : (n,) array
        How far a force moves its own unknown, in energy: what is left of a load is as nothing where it is so both as a
        force and by what it does. Of a load on a stiff part 1e-15 on a part that is softer by 1e16 is not.
    """

    def __init__(self, n: int, solve: Callable[[Floats, int | None], SolvedForce], ease: Floats):
        self._n, self._solve, self._ease = n, solve, ease
        self._loaded = np.zeros(0, dtype=np.int64)
        self._place = np.full(n, -1)  # in `_loaded`
        self._basis: list[tuple[Floats, float, Floats, SolvedForce]] = []

    def parts(self, phi: Floats, rows: Ints | None = None) -> Parts:
        """The combination that a force is, (n,) or on some rows; what is new in it is solved for.

        That is remembered while there is room.
        """
        entries = self._on_loaded(phi, rows)
        # Squares of forces, of any unit, are numbers when the largest is of size one.
        unit = float(power_of_two(np.abs(entries).max(initial=0.0)))
        rest = entries / unit
        size, found = self._sizes(rest), Parts()
        known = size
        for q, square, whole, one in self._basis if size.any() else ():
            share = float(q @ rest) / square
            rest = rest - share * q
            known = known + abs(share) * whole
            found[one] = unit * share
        if (self._sizes(rest) <= SAME_FIELD * np.minimum(known, 8.0 * size)).all():
            return found
        if len(self._basis) == MOST_FIELDS:
            return self.afresh(spread(entries, self._loaded, self._n))
        new = self._solve(spread(rest, self._loaded, self._n), len(self._basis))
        self._basis.append((rest, float(rest @ rest), size, new))
        return {**found, new: unit}

    def afresh(self, phi: Floats) -> Parts:
        """A force (n,) that is solved for whatever has been seen, and not remembered."""
        unit = float(power_of_two(np.abs(phi).max(initial=0.0)))
        return {self._solve(phi / unit, None): unit}

    def _sizes(self, entries: Floats) -> Floats:
        """The norms of a force with these entries, and of the motions of single unknowns under it."""
        done = self._ease[self._loaded] * entries
        sizes: Floats = np.sqrt(np.array([entries @ entries, done @ done]))
        return sizes

    def _on_loaded(self, phi: Floats, rows: Ints | None) -> Floats:
        """A force on the unknowns that any force loads; those that it is the first to load join them."""
        some = np.flatnonzero(phi)
        rows, phi = some if rows is None else rows[some], phi[some]
        if (self._place[rows] < 0).any():
            before, self._loaded = self._loaded, np.union1d(self._loaded, rows)
            self._place[self._loaded] = np.arange(len(self._loaded))
            place, count = self._place[before], len(self._loaded)
            self._basis = [(spread(q, place, count), a, b, one) for q, a, b, one in self._basis]
        return spread(phi, self._place[rows], len(self._loaded))


def spread(values: Floats, rows: Ints, n: int) -> Floats:
    """The force (n,) with these values on some rows."""
    phi = np.zeros(n)
    phi[rows] = values
    return phi
