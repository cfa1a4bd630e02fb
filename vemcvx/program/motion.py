"""Supports that move: what u_D adds to the energy, to the norm terms and to the limits of a system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from vemcvx.arguments import called
from vemcvx.arrays import EPS, Floats, as_real_array, brief, shape_in_words
from vemcvx.errors import SceneError
from vemcvx.program.checks import finite
from vemcvx.program.forces import ForceOnPart

DRAG_ROUNDING = 16 * EPS
"""Slips below this part of the positions that they are differences of are zero but for rounding: they drag nothing."""


@dataclass(frozen=True)
class Motion:
    """What moving supports add when u = P y + u_D(t), with A the matrix of a over all of u.

    a(u, u) = y'Ky + 2 y'dirichlet_force + stored, and the norm terms measure B (y - y_prev) plus the prescribed slip,
    less that of the step before. Where the supports move far, and strain little, these sums cancel; `frame` and `pair`
    give the same without.
    """

    dirichlet_force: Callable[[float], Floats]
    """t -> (n,), P'A u_D"""
    prescribed_slip: Callable[[float], Floats]
    """t -> (m * block,), what u_D adds to the argument of the norms"""
    stored: Callable[[float, float], float]
    """(s, t) -> u_D(s)'A u_D(t)"""
    frame: Callable[[float, Floats], Floats]
    """(t, y) -> (n_u,), u seen from the body: less a motion that strains nothing"""
    pair: Callable[[Floats, Floats], float]
    """a of two such fields"""
    remaining_gap: Callable[[float], Floats] | None = None
    """t -> (r,), what u_D takes from the limits"""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not callable(value) and not (name == "remaining_gap" and value is None):
                raise SceneError(f"Motion: found {name} = {brief(value)}; wanted a function.")

    def sized(self, n: int, rows: int, limits: int) -> Motion:
        """The same, whose functions are checked whenever they are called; what they give is kept by nobody else."""
        shapes = {
            "dirichlet_force": (n,),
            "prescribed_slip": (rows,),
            "stored": (),
            "pair": (),
            "remaining_gap": (limits,),
        }

        def checked(name: str, function: Callable[..., ArrayLike]) -> Callable[..., Any]:
            def value(*given: Any) -> Any:
                subject = f"Motion: {name}"
                wanted = f"numbers of shape {shapes.get(name, '(n_u,)')}"
                x = as_real_array(called(function, given, f"{subject} failed", f"return {wanted}"), subject, wanted)
                if shapes.get(name) == () and x.size == 1:
                    x = x.reshape(())
                if x.shape != shapes.get(name, x.shape[:1]):
                    raise SceneError(f"{subject}: found {shape_in_words(x)}; wanted {wanted}.")
                finite(x, subject)
                return x if x.ndim else float(x)

            return value

        functions: dict[str, Any] = {
            name: f if isinstance(f, ForceOnPart) else f and checked(name, f) for name, f in vars(self).items()
        }
        return Motion(**functions)
