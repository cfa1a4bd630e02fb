"""What every material is: a law for the cells of a region, the whole body unless `on` names cells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vemcvx.arrays import Bools
from vemcvx.effects.effect import Effect
from vemcvx.errors import SceneError
from vemcvx.vem import Space

PLANES = ("strain", "stress")


class MaterialLaw(Effect):
    """An effect that says what cells are made of; a scene has at least one, and every cell exactly one."""


def region(space: Space, on: str | Sequence[str] | None, subject: str) -> Bools | None:
    """The cells (n_cells,) where one of the cell data named by `on` is nonzero; None for the whole body."""
    if on is None:
        return None
    known = space.mesh.cell_data
    names = [on] if isinstance(on, str) else list(on) if isinstance(on, Sequence) else [on]
    cells = np.zeros(space.mesh.n_cells, dtype=bool)
    for name in names:
        if not isinstance(name, str) or name not in known or known[name].ndim != 1:
            there_are = ", ".join(repr(n) for n in known if known[n].ndim == 1) or "none"
            raise SceneError(
                f"{subject}: on= names cells by a cell datum that is nonzero there; found {name!r}, but this mesh has "
                f"{there_are}. Add one with mesh.with_cell_data(name, values)."
            )
        cells |= known[name] != 0
    if not cells.any():
        raise SceneError(f"{subject}: on={on!r} names no cell: the cell datum is zero everywhere on this mesh.")
    return cells
