"""Fields of bodies between rays that meet at a point: exponents, the stress that grows, and logarithms.

Near a point where sides meet, displacements behave as r^lam and stresses as r^(lam - 1), with lam the exponent with the
smallest positive real part of the fields that satisfy equilibrium and the conditions of both sides (Williams, *Stress
singularities resulting from various boundary conditions in angular corners of plates in extension*, J. Appl. Mech. 19,
1952). Below 1 a computed stress grows without limit as the mesh is refined, by 2^(1 - lam) where cells are halved. In
a sector of an isotropic body in the plane, kappa = (lambda + 3 mu) / (lambda + mu),

    sigma_tt = lam (lam + 1) F,   sigma_rt = -lam F',   sigma_rr = F'' + (lam + 1) F,
    F = A cos (lam+1) t + B sin (lam+1) t + C cos (lam-1) t + D sin (lam-1) t,
    2 mu u_r = -(lam + 1) F + (kappa + 1) (C cos (lam-1) t + D sin (lam-1) t)
    2 mu u_t = -F'          + (kappa + 1) (C sin (lam-1) t - D cos (lam-1) t)

all times powers of r. Two conditions at each end, four where two bodies meet, M(lam) x = 0: the exponents are the zeros
of the determinant.

Given tractions b are met by stress that is bounded if M(1) x = b has a solution. In general,

    u = the residue at lam = 1 of r^lam M(lam)^-1 b / (lam - 1)

meets them, and with M(lam)^-1 = R / (lam - 1) + ... has stress log r times that of R b, which is constant in a sector
(Dempsey, *The wedge subjected to tractions: a paradox resolved*, J. Elasticity 11, 1981; Sinclair, *Logarithmic stress
singularities resulting from various boundary conditions in angular corners of plates in extension*, J. Appl. Mech. 66,
1999). Where cells are halved it adds -log(2) times as much. Between tractions R b is a rotation, without stress, at
all angles a but 180 and 360 degrees, and that of tan a = a, 257 degrees, where the power is stronger: shear that
jumps along a straight side gives a logarithm, shear on one side of a right angle does not. Between a traction and
contact, or a roller, it is no rotation at 90 degrees: the shear of the one side is to be that of the other, as stress
is symmetric.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from vemcvx.base.arrays import Floats

Complex = NDArray[np.complex128]
LIMIT = 0.99
"""Exponents from here on are no corner's that matters: at .99 stress grows by .7 % where cells are halved."""


@dataclass(frozen=True)
class Sector:
    """A body between two rays: how far it turns, and its material."""

    angle: float
    kappa: float
    shear: float

    def fields(self, lam: Complex, t: float | Floats) -> Complex:
        """(q, 5, 4) u_r, u_t, sigma_tt / lam, sigma_rt / lam and sigma_rr on rays t, by columns of A, B, C and D."""
        plus, minus, none = (lam + 1) * t, (lam - 1) * t, np.zeros_like(lam)
        F = np.array([np.cos(plus), np.sin(plus), np.cos(minus), np.sin(minus)])
        rates = np.array([-(lam + 1), lam + 1, -(lam - 1), lam - 1])
        slope = rates * F[[1, 0, 3, 2]]
        radial = np.array([none, none, F[2], F[3]])
        across = np.array([none, none, F[3], -F[2]])
        u_r = (-(lam + 1) * F + (self.kappa + 1) * radial) / (2 * self.shear)
        u_t = (-slope + (self.kappa + 1) * across) / (2 * self.shear)
        return np.moveaxis(np.array([u_r, u_t, (lam + 1) * F, -slope, (lam + 1 - rates**2) * F]), 2, 0)


FREE = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
CLAMPED = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])


def held_along(radial: float, across: float) -> Floats:
    """The conditions of a side that is held along a direction with these components, and carries nothing across it."""
    return np.array([[radial, across, 0.0, 0.0], [0.0, 0.0, radial, -across]])


def slipping(friction: float) -> Floats:
    """The conditions of a side that slides on a rigid obstacle: sigma_rt = friction sigma_tt."""
    return np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -friction, 1.0]])


def joined(state: str, friction: float = 0.0) -> tuple[Floats, Floats]:
    """The conditions (4, 4) on both sides of a joint, which add up to zero: "open", "sticks" or "slips"."""
    one, other = np.zeros((4, 4)), np.zeros((4, 4))
    if state == "open":
        one[:2], other[2:] = FREE, FREE
    elif state == "sticks":
        one, other = np.eye(4), -np.eye(4)
    else:
        one[:3], other[:3] = np.eye(4)[1:], -np.eye(4)[1:]
        one[3] = slipping(friction)[1]
    return one, other


@dataclass(frozen=True, eq=False)
class Wedge:
    """Bodies that meet at a point, counter-clockwise."""

    sectors: Sequence[Sector]
    joints: Sequence[tuple[Floats, Floats]]  # one between each two; of a full ring one more, from the last to the first
    ends: tuple[Floats, Floats] | None  # conditions (2, 4) on the first ray and on the last one; None of a ring

    @property
    def angle(self) -> float:
        """The angle of all sectors together."""
        return sum(sector.angle for sector in self.sectors)

    def matrix(self, lam: Complex) -> Complex:
        """(q, 4 s, 4 s) the conditions on A, B, C and D of each sector, those of joints first."""
        count = len(self.sectors)
        matrix = np.zeros((len(lam), 4 * count, 4 * count), dtype=complex)
        unit = self.sectors[0].shear
        scale = np.array([unit, unit, 1.0, 1.0])[:, None]
        first = [scale * sector.fields(lam, 0.0)[:, :4] for sector in self.sectors]
        last = [scale * sector.fields(lam, sector.angle)[:, :4] for sector in self.sectors]
        for k, (one, other) in enumerate(self.joints):
            after, rows = (k + 1) % count, slice(4 * k, 4 * k + 4)
            matrix[:, rows, 4 * k : 4 * k + 4] += one @ last[k]
            matrix[:, rows, 4 * after : 4 * after + 4] += other @ first[after]
        if self.ends is not None:
            matrix[:, -4:-2, :4] = self.ends[0] @ first[0]
            matrix[:, -2:, -4:] = self.ends[1] @ last[-1]
        return matrix

    @cached_property
    def leading(self) -> complex:
        """The exponent with the smallest real part between 0 and 1, 1 if there is none."""
        real, imaginary = np.meshgrid(np.linspace(0.06, 0.98, 13), [0.0, 0.1, 0.4])
        lam = (real + 1j * imaginary).ravel()

        def determinant(lam: Complex) -> Complex:
            return np.linalg.det(self.matrix(lam))

        with np.errstate(all="ignore"):
            # Double zeros, as of a crack, are approached by halves.
            for _ in range(30):
                value, h = determinant(lam), 1e-6
                step = value * 2 * h / (determinant(lam + h) - determinant(lam - h))
                lam = np.where(np.isfinite(step) & (np.abs(step) < 1.0), lam - step, lam)
            settled = np.isfinite(step) & (np.abs(step) < 1e-6)
        found = lam[settled & (lam.real > 0.02) & (lam.real < LIMIT) & (np.abs(lam.imag) < 2.0)]
        return complex(found[np.argmin(found.real)]) if len(found) else 1.0 + 0.0j

    @property
    def exponent(self) -> float:
        """The real part of `leading`."""
        return self.leading.real

    @cached_property
    def mode(self) -> Floats | None:
        """A, B, C and D of the field with the leading exponent; None where that is complex, or has several."""
        if abs(self.leading.imag) > 1e-6:
            return None
        _, sizes, rows = np.linalg.svd(self.matrix(np.array([self.leading]))[0].real)
        found: Floats = rows[-1]
        return found if sizes[-2] > 1e-4 * sizes[0] else None

    def logarithm(self, given: Floats) -> Floats | None:
        """A, B, C and D of R b, with the exponent 1: the stress that log r multiplies; None where it is rounding."""
        if not given.any():
            return None
        steps = np.array([1e-4, -1e-4])  # far beside the rounding of angles
        matrices: Floats = self.matrix(np.array(1.0 + steps, dtype=np.complex128)).real
        both = np.array([np.linalg.solve(matrix, given) for matrix in matrices])
        found: Floats = 0.5 * steps @ both  # Terms of odd order cancel.
        rotations = np.arange(len(found)) % 4 == 3
        return found if np.abs(found[~rotations]).max() > 1e-6 * np.abs(given).max() else None

    def stress(self, lam: float, x: Floats, t: Floats) -> Floats:
        """(q, 3) xx, yy and xy, x along the first ray, of the field with this exponent at angles, for r = 1."""
        starts = np.cumsum([0.0, *(sector.angle for sector in self.sectors)])
        of = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(self.sectors) - 1)
        # Stresses do not depend on the material.
        fields = self.sectors[0].fields(np.full(len(t), lam, dtype=complex), t - starts[of]).real[:, [4, 2, 3]]
        rr, tt, rt = np.einsum("qka,qa->kq", fields, x.reshape(-1, 4)[of])
        return turned(np.column_stack([rr, lam * tt, lam * rt]), t)


def turned(stress: Floats, t: Floats | float) -> Floats:
    """Stress (q, 3) of components xx, yy and xy in a frame, in the one that it is turned from by angles."""
    cos, sin = np.cos(t), np.sin(t)
    xx, yy, xy = stress.T
    both = 2 * cos * sin * xy
    rows = [cos**2 * xx + sin**2 * yy - both, sin**2 * xx + cos**2 * yy + both]
    return np.column_stack([*rows, cos * sin * (xx - yy) + (cos**2 - sin**2) * xy])
