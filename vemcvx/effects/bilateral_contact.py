"""Contact without separation, u . n = 0 on Gamma_C, the first line of (3.6)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vemcvx.effects.contribution import ContactSurface, Contribution, Support
from vemcvx.effects.effect import Effect, where
from vemcvx.errors import SceneWarning
from vemcvx.vem import BoundaryRows, Space


@dataclass(frozen=True)
class BilateralContact(Effect):
    """Contact without separation: u . n = 0 at the nodes of `on`.

    The contact boundary Gamma_C is piecewise straight and may be inclined. At a corner u . n = 0 for both normals,
    which fixes the node; on a curved interface, a polygon with many corners, that bonds the bodies, and a warning says
    so. Clamps and prescribed displacements take precedence at nodes that they share with contact.

    Parameters
    ----------
    on : str or sequence of str
        Names of boundaries, or of interfaces between bodies: u is then that of the first body relative to the second,
        and n the outward normal of the first.
    """

    on: str | Sequence[str]

    def contribute(self, space: Space) -> Contribution:
        rows = space.part(self.on, "BilateralContact", contact=True).node_normals
        _warn_of_bonds(rows, where(self.on))
        support = Support(
            subject="BilateralContact",
            nodes=rows.nodes,
            directions=rows.normals,
            points=space.mesh.points[rows.nodes],
            contact=True,
            partners=rows.partners,
        )
        return Contribution(supports=(support,), surfaces=(ContactSurface.of(rows),))

    def describe(self) -> str:
        return f"BilateralContact: u.n = 0 on {where(self.on)}"


def _warn_of_bonds(rows: BoundaryRows, on: str) -> None:
    """Say that what looks curved does not slide: corners of an interface that turn by less than 45 degrees."""
    follows = (np.diff(rows.nodes) == 0) & (rows.partners[1:] == rows.partners[:-1]) & (rows.partners[1:] >= 0)
    flat = np.einsum("ij,ij->i", rows.normals[1:], rows.normals[:-1]) > np.cos(np.pi / 4)
    bonded = int((follows & flat).sum())
    if bonded:
        warnings.warn(
            f"BilateralContact on {on}: sides meet at {bonded} of {len(np.unique(rows.nodes))} nodes, as on a curve, "
            "and u.n = 0 for both bonds the bodies there, without friction, too. UnilateralContact lets them slide "
            "where they are pressed together.",
            SceneWarning,
            stacklevel=2,
        )
