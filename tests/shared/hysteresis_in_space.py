"""The frictional hysteresis patch test in space: a block is dragged along a curve over a table, with Tresca's friction.

The bottom is in bilateral contact with the friction bound g, and the top moves by U(t) in the plane. Then
u = (a + gamma z, 0) with vectors a and gamma:

    gamma_n = P((U_n - a_{n-1}) / H),   P the projection on the disc of radius g / mu,   a_n = U_n - gamma_n H,

with tractions (0, 0, +-mu gamma_x) on the sides normal to x and (0, 0, +-mu gamma_y) on the sides normal to y.
Backward Euler is exact on every mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import vemcvx as vx

MU, BOUND, POISSON = 80.0, 6.0, 0.3
SIZE = np.array([1.0, 1.2, 0.9])
BOX = tuple((0.0, float(length)) for length in SIZE)
AXES = np.eye(3)
REACH = BOUND * SIZE[2] / MU
"""The largest displacement of the top relative to the foot while the foot sticks."""


@dataclass(frozen=True)
class Turn:
    """A path of the top at the instants 0, 1, ..., and the exact solution."""

    top: np.ndarray
    """displacements U (N + 1, 2) of the top"""
    foot: np.ndarray
    """displacements a (N + 1, 2) of the foot"""

    @classmethod
    def along(cls, top, foot):
        """Return the solution for a path of the top and the initial displacement of the foot."""
        feet = [np.asarray(foot, dtype=float)]
        for place in top[1:]:
            apart = place - feet[-1]
            feet.append(place - apart * min(1.0, REACH / max(np.linalg.norm(apart), 1e-300)))
        return cls(np.asarray(top), np.array(feet))

    @property
    def times(self):
        return np.arange(len(self.top), dtype=float)

    @property
    def shear(self):
        """Shear strains gamma (N + 1, 2)."""
        return (self.top - self.foot) / SIZE[2]

    def displacement(self, points):
        """Return the displacements (N + 1, n_nodes, 3)."""
        u = np.zeros((len(self.top), *points.shape))
        u[:, :, :2] = self.foot[:, None] + points[:, 2, None] * self.shear[:, None]
        return u

    def scene(self, friction=None, axes=AXES):
        """Return the scene of the block; `axes` are the directions of its three axes if it is rotated."""

        def top(x, t):
            return np.tile(axes[:, :2] @ self.top[round(t)], (len(x), 1))

        def side(axis, sign):
            return lambda x, t: np.tile(sign * MU * self.shear[round(t), axis] * axes[:, 2], (len(x), 1))

        sides = ("left", 0, -1), ("right", 0, 1), ("front", 1, -1), ("back", 1, 1)
        return vx.Scene(
            vx.Elasticity(2 * MU * (1 + POISSON), POISSON),
            vx.PrescribedDisplacement(top, on="top"),
            *(vx.Traction(side(axis, sign), on=name) for name, axis, sign in sides),
            vx.BilateralContact(on="bottom"),
            friction or vx.TrescaFriction(BOUND, on="bottom"),
        )


def curve():
    """Return a path on which the block sticks, slides along a curve, sticks after a reversal, and slides again."""
    places = [(0, 0), (0.6, 0.4), (2.0, 0.5), (2.5, 2.0), (2.1, 1.7), (-1.0, 2.0), (-1.0, -1.5)]
    return Turn.along(REACH * np.array(places), (0.0, 0.0))
