"""What is in the collection: steps of problem files, graded by what makes them hard."""

from __future__ import annotations

from dataclasses import dataclass

VERSION = 2
"""Of the list below: other instances, or others under the same names, are another version."""


@dataclass(frozen=True, kw_only=True)
class Instance:
    """One step of one run.

    Parameters
    ----------
    grade : str
        "easy", "sizes", "bounds", "pressure" (Coulomb), "soft", "viscous", "sticking", "degenerate", "incompressible",
        "units" or "discs" (friction in space).
    problem : str
        The problem file.
    n, of, step : int
        Cells per unit length, steps of the run, and which of them.
    settings : tuple of str
        Parameters of the scene, "name=value".
    condense : bool
        On the unknowns of contact, or on all.
    degenerate : bool
        Weights of terms that stick are lowered to what these carry: the answer stays, and every such term is at once
        at rest and at its bound.
    """

    grade: str
    problem: str
    n: int
    of: int
    step: int
    settings: tuple[str, ...] = ()
    condense: bool = True
    degenerate: bool = False

    @property
    def name(self) -> str:
        """All of that in one word."""
        ends = ("-full" * (not self.condense), "-degenerate" * self.degenerate)
        settings = "".join(f"-{setting.replace('=', '')}" for setting in self.settings)
        return f"{self.problem}-n{self.n}-{self.step}of{self.of}{settings}{''.join(ends)}"

    @property
    def run(self) -> tuple[str, int, int, tuple[str, ...], bool]:
        """The run that it is a step of."""
        return self.problem, self.n, self.of, self.settings, self.condense


SI = "young=2e11", "bound=4e9", "push=8e9", "press=1e7"
TINY = "young=2e-4", "bound=4e-6", "push=8e-6", "press=1e-8"
PAPER = "feng_han_huang"

# grade, problem, cells per unit length, steps, settings
Row = tuple[str, str, tuple[int, ...], tuple[int, ...], tuple[str, ...]]
PLAIN: tuple[str, ...] = ()
NEAR_HALF = ("poisson=0.499",), ("poisson=0.49999",), ("poisson=0.4999999",)
CONDENSED: tuple[Row, ...] = (
    ("easy", PAPER, (8, 16), (4, 8), PLAIN),
    ("easy", "frictional_hysteresis", (4, 8), (2,), PLAIN),
    ("easy", "manufactured_full_slip", (8, 16), (2,), PLAIN),
    ("sizes", PAPER, (32, 64), (4, 8), PLAIN),
    ("bounds", "hertz_contact", (6, 12), (2, 8), PLAIN),
    ("bounds", "block_between_dies", (6, 12), (2,), PLAIN),
    ("bounds", "beam_on_a_stop", (6,), (2, 8), PLAIN),
    ("pressure", "cattaneo_mindlin", (6,), (2, 8), PLAIN),
    ("pressure", "janssen_silo", (4,), (2, 8), PLAIN),
    ("pressure", "block_with_grain", (6, 12), (2, 8), PLAIN),
    ("soft", "rough_layer", (6, 12), (2, 8), PLAIN),
    ("viscous", "kelvin_voigt_creep", (6,), (2, 5, 8), PLAIN),
    ("sticking", "shear_lag", (6,), (2, 5, 8), PLAIN),
    ("sticking", "thermal_expansion_blocked_by_friction", (6,), (2, 5, 8), PLAIN),
    ("sticking", "l_shaped_bracket", (8, 16), (6, 8), PLAIN),
    *(("incompressible", PAPER, (16,), (8,), near) for near in NEAR_HALF),
    *(("units", PAPER, (8, 16), (8,), units) for units in (SI, TINY)),
    ("discs", "block_in_space", (4,), (4, 8), PLAIN),
    ("discs", "block_in_space", (8,), (8,), PLAIN),
    ("discs", "circular_hysteresis", (2,), (4, 8), PLAIN),
    ("discs", "block_dragged_along_a_curve", (4,), (8,), PLAIN),
)
ON_ALL_UNKNOWNS: tuple[Row, ...] = (
    ("sizes", PAPER, (8, 16, 32), (4, 8), PLAIN),
    ("sizes", PAPER, (64,), (8,), PLAIN),
    ("bounds", "hertz_contact", (6,), (8,), PLAIN),
    ("pressure", "block_with_grain", (6,), (8,), PLAIN),
    ("viscous", "kelvin_voigt_creep", (6,), (8,), PLAIN),
    *(("incompressible", PAPER, (16,), (8,), near) for near in NEAR_HALF),
    *(("units", PAPER, (8,), (8,), units) for units in (SI, TINY)),
    ("discs", "block_in_space", (4,), (8,), PLAIN),
)
DEGENERATE: tuple[Row, ...] = (
    ("degenerate", "l_shaped_bracket", (8, 16), (6, 8), PLAIN),
    ("degenerate", PAPER, (16, 32), (6, 8), PLAIN),
)
INSTANCES = tuple(
    Instance(
        grade=grade,
        problem=problem,
        n=n,
        of=8,
        step=step,
        settings=settings,
        condense=rows is not ON_ALL_UNKNOWNS,
        degenerate=rows is DEGENERATE,
    )
    for rows in (CONDENSED, ON_ALL_UNKNOWNS, DEGENERATE)
    for grade, problem, cells, steps, settings in rows
    for n in cells
    for step in steps
)
