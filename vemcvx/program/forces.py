"""Forces and what they do, as combinations of a few that are solved for.

A load that keeps its shape, or changes between a few, has the responses of these shapes; products phi'x of combinations
are those of the shapes. A step then works with as many numbers as there are shapes, and with vectors of all unknowns
only where somebody asks for them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from vemcvx.arrays import Floats, Ints, power_of_two

SAME_FIELD = 8 * float(np.finfo(float).eps)
"""Residuals of a load on the fields solved for below this times the load are rounding, and are dropped."""
MOST_ROUNDING = 8.0
"""A field that was solved for as a small part of a load carries that load's rounding, and a combination with large
shares amplifies it. At most so many times a load's own rounding is dropped; a load that turns in space left 1.4."""
NEAR = 1e-6
"""Relative difference of forces on the retained unknowns, far above their rounding."""
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
    phi, v : (n,) arrays
        The force; a response to what of it acts inside, (K v)_i = phi_i, wherever the retained unknowns are. Where
        there is a `product`, the first half of a solve instead.
    v_c, retained, released : (m,) arrays
        Of the retained unknowns: where they are in v; tau, the force that phi makes there; how far it moves them if
        nothing holds them.
    number : int or None
        Which of those that are remembered; None if it is not.
    respond : callable () -> (n,)
        K^{-1} phi, which few ask for.
    product : callable, optional
        phi'xi of two forces from their first halves.
    """

    phi: Floats
    v: Floats
    v_c: Floats
    retained: Floats
    released: Floats
    number: int | None
    respond: Callable[[], Floats]
    product: Callable[[Floats, Floats], float] | None = None
    _products: dict[int, tuple[float, float]] = field(default_factory=dict, repr=False)

    @cached_property
    def x(self) -> Floats:
        """K^{-1} phi (n,)."""
        return self.respond()

    def products(self, other: SolvedForce) -> tuple[float, float]:
        """phi'x = phi'xi + tau'x_c and phi'xi, with the responses of another field."""
        if self.number is not None and other.number in self._products:
            return self._products[other.number]
        if self.product is not None:
            inside = self.product(self.v, other.v)
        else:
            inside = float(self.phi @ other.v) - float(self.retained @ other.v_c)
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
    within : dict of SolvedForce to float
        What of it acts inside, where the retained unknowns do not.
    retained : (m,) array
        tau, the force that it makes there.
    """

    def __init__(self, phi: Callable[[], Floats], parts: Parts, within: Parts, retained: Floats):
        self._phi, self.parts, self.within, self.retained = phi, parts, within, retained

    @cached_property
    def phi(self) -> Floats:
        """The force (n,)."""
        return self._phi()

    @cached_property
    def x(self) -> Floats:
        """Its response K^{-1} phi (n,)."""
        return combined([(share, one.x) for one, share in self.parts.items()], self.phi)

    @property
    def inner(self) -> tuple[Floats, Floats]:
        """v (n,) and v_c (m,) of what of it acts inside, as a :class:`SolvedForce` has them."""
        v = combined([(share, one.v) for one, share in self.within.items()], self.phi)
        return v, combined([(share, one.v_c) for one, share in self.within.items()], self.retained)

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
        pairs = ((one, a, two, b) for one, a in self.within.items() for two, b in other.within.items())
        # Each share carries the unit of its force: the product of two may be no number where that of all three is.
        return float(sum(a * (b * one.products(two)[1]) for one, a, two, b in pairs))

    def same(self, other: Reduced) -> bool:
        """Return True if the forces are equal; most that are not differ in what they do."""
        apart = np.abs(self.retained - other.retained).max(initial=0.0)
        near = apart <= NEAR * np.abs(self.retained).max(initial=0.0)
        return bool(near) and np.array_equal(self.phi, other.phi)

    def __add__(self, other: Reduced) -> Reduced:
        return self._and(other, 1.0)

    def __sub__(self, other: Reduced) -> Reduced:
        return self._and(other, -1.0)

    def _and(self, other: Reduced, sign: float) -> Reduced:
        return Reduced(
            lambda: self.phi + sign * other.phi,
            _merged(self.parts, other.parts, sign),
            _merged(self.within, other.within, sign),
            self.retained + sign * other.retained,
        )


def combined(shares: Sequence[tuple[float, Floats]], like: Floats) -> Floats:
    """The sum of shares of arrays; zeros like another if there are none."""
    total = np.zeros_like(like)
    with np.errstate(over="ignore", invalid="ignore"):
        for share, array in shares:
            total += share * array
    return total


def _merged(parts: Parts, others: Parts, sign: float) -> Parts:
    return {one: parts.get(one, 0.0) + sign * others.get(one, 0.0) for one in {**parts, **others}}


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
        self._places: dict[int, tuple[Ints, Ints, Ints]] = {}
        self._basis: list[tuple[Floats, float, Floats, SolvedForce]] = []

    def parts(self, phi: Floats, rows: Ints | None = None) -> Parts:
        """The combination that a force is, (n,) or on some rows; what is new in it is solved for.

        That is remembered while there is room.
        """
        entries = self._compress(phi) if rows is None else self._placed(phi, rows)
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
        if (self._sizes(rest) <= SAME_FIELD * np.minimum(known, MOST_ROUNDING * size)).all():
            return found
        if len(self._basis) == MOST_FIELDS:
            return self.afresh(self._expand(entries))
        new = self._solve(self._expand(rest), len(self._basis))
        self._basis.append((rest, float(rest @ rest), size, new))
        return {**found, new: unit}

    def _sizes(self, entries: Floats) -> Floats:
        """The norms of a force with these entries, and of the motions of single unknowns under it."""
        done = self._ease[self._loaded] * entries
        sizes: Floats = np.sqrt(np.array([entries @ entries, done @ done]))
        return sizes

    def afresh(self, phi: Floats) -> Parts:
        """A force (n,) that is solved for whatever has been seen, and not remembered."""
        unit = float(power_of_two(np.abs(phi).max(initial=0.0)))
        return {self._solve(phi / unit, None): unit}

    def _compress(self, phi: Floats) -> Floats:
        """The entries of `phi` that may differ from zero; loads on a boundary touch few of all."""
        if np.count_nonzero(phi) != np.count_nonzero(phi[self._loaded]):
            self._touch(np.flatnonzero(phi))
        return phi[self._loaded]

    def _placed(self, values: Floats, rows: Ints) -> Floats:
        """The same of a force on some rows, which as a rule was there before, on the same."""
        same, known, places = self._places.get(id(rows), (None, rows, rows))
        if same is not rows or np.count_nonzero(values) != np.count_nonzero(values[known]):
            self._touch(rows[values != 0.0])
            known = np.flatnonzero(np.isin(rows, self._loaded))
            places = np.searchsorted(self._loaded, rows[known])
            self._places[id(rows)] = rows, known, places
        return spread(values[known], places, len(self._loaded))

    def _touch(self, rows: Ints) -> None:
        """Count these among the unknowns that some force loads."""
        loaded = np.union1d(self._loaded, rows)
        self._basis = [(self._expand(q)[loaded], square, size, one) for q, square, size, one in self._basis]
        self._loaded, self._places = loaded, {}

    def _expand(self, compressed: Floats) -> Floats:
        """The force (n,) with these entries."""
        return spread(compressed, self._loaded, self._n)


def spread(values: Floats, rows: Ints, n: int) -> Floats:
    """The force (n,) with these values on some rows."""
    phi = np.zeros(n)
    phi[rows] = values
    return phi
