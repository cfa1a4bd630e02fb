"""What is in the collection: steps of problem files, graded by what makes them hard."""

from __future__ import annotations

from collections.abc import Iterator
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


def _all() -> Iterator[Instance]:
    for n in (8, 16):
        for step in (4, 8):
            yield Instance(grade="easy", problem=PAPER, n=n, of=8, step=step)
        yield Instance(grade="easy", problem="frictional_hysteresis", n=n // 2, of=8, step=2)
        yield Instance(grade="easy", problem="manufactured_full_slip", n=n, of=8, step=2)
    for n in (32, 64):
        for step in (4, 8):
            yield Instance(grade="sizes", problem=PAPER, n=n, of=8, step=step)
    for n in (8, 16, 32):
        for step in (4, 8):
            yield Instance(grade="sizes", problem=PAPER, n=n, of=8, step=step, condense=False)
    yield Instance(grade="sizes", problem=PAPER, n=64, of=8, step=8, condense=False)
    for problem, n, steps in (
        ("hertz_contact", 6, (2, 8)),
        ("hertz_contact", 12, (2, 8)),
        ("block_between_dies", 6, (2,)),
        ("block_between_dies", 12, (2,)),
        ("beam_on_a_stop", 6, (2, 8)),
    ):
        for step in steps:
            yield Instance(grade="bounds", problem=problem, n=n, of=8, step=step)
    yield Instance(grade="bounds", problem="hertz_contact", n=6, of=8, step=8, condense=False)
    for problem, n in (("cattaneo_mindlin", 6), ("janssen_silo", 4), ("block_with_grain", 6), ("block_with_grain", 12)):
        for step in (2, 8):
            yield Instance(grade="pressure", problem=problem, n=n, of=8, step=step)
    yield Instance(grade="pressure", problem="block_with_grain", n=6, of=8, step=8, condense=False)
    for n in (6, 12):
        for step in (2, 8):
            yield Instance(grade="soft", problem="rough_layer", n=n, of=8, step=step)
    for step in (2, 5, 8):
        yield Instance(grade="viscous", problem="kelvin_voigt_creep", n=6, of=8, step=step)
    yield Instance(grade="viscous", problem="kelvin_voigt_creep", n=6, of=8, step=8, condense=False)
    for problem in ("shear_lag", "thermal_expansion_blocked_by_friction"):
        for step in (2, 5, 8):
            yield Instance(grade="sticking", problem=problem, n=6, of=8, step=step)
    for n in (8, 16):
        for step in (6, 8):
            yield Instance(grade="sticking", problem="l_shaped_bracket", n=n, of=8, step=step)
            yield Instance(grade="degenerate", problem="l_shaped_bracket", n=n, of=8, step=step, degenerate=True)
            yield Instance(grade="degenerate", problem=PAPER, n=2 * n, of=8, step=step, degenerate=True)
    for poisson in ("0.499", "0.49999", "0.4999999"):
        for condense in (True, False):
            near = (f"poisson={poisson}",)
            yield Instance(grade="incompressible", problem=PAPER, n=16, of=8, step=8, settings=near, condense=condense)
    for settings in (SI, TINY):
        for n in (8, 16):
            yield Instance(grade="units", problem=PAPER, n=n, of=8, step=8, settings=settings)
        yield Instance(grade="units", problem=PAPER, n=8, of=8, step=8, settings=settings, condense=False)
    for problem, n, steps in (("block_in_space", 4, (4, 8)), ("circular_hysteresis", 2, (4, 8))):
        for step in steps:
            yield Instance(grade="discs", problem=problem, n=n, of=8, step=step)
    yield Instance(grade="discs", problem="block_in_space", n=8, of=8, step=8)
    yield Instance(grade="discs", problem="block_in_space", n=4, of=8, step=8, condense=False)
    yield Instance(grade="discs", problem="block_dragged_along_a_curve", n=4, of=8, step=8)


INSTANCES = tuple(_all())
