"""The instances of the collection: steps of runs of the problem files, graded by what makes them hard.

*easy* and *sizes* are the paper's scene and closed forms; *bounds* one-sided contact; *pressure* friction whose weights
are Coulomb's, at the pressures of the solution; *discs* friction in space, a second-order cone a contact; *bodies*
several of them; *floating* a K with a kernel, held by friction and contact alone; *soft* obstacles that give way;
*viscous* matrices of rates; *sticking* terms of which few slip; *degenerate* terms that are at rest and at their bound
at once; *incompressible* and *units* K of condition up to 1e9 and numbers of other sizes; *large* sparse K of up to a
million unknowns; *no optimum* programs that are infeasible or unbounded, with a certificate of that; *sequences* the
256 steps of a run, each with the answer before for a start; *fclib* steps with Coulomb's law itself, as files of the
Frictional Contact Library.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

VERSION = 4
"""The version of the list below: other instances, or others under the same names, are another version."""
INFEASIBLE, UNBOUNDED, FCLIB = "infeasible", "unbounded", "fclib"


@dataclass(frozen=True, kw_only=True)
class Instance:
    """Step `step` of a run of `of` steps of a problem file, with n cells per unit length and settings "name=value".

    Of three numbers n each is the number of cells along an axis.

    In a degenerate instance the weights of terms that stick are lowered to what these carry: the answer stays, and
    every such term is at once at rest and at its bound. An instance with `without` has no optimum: it is infeasible or
    unbounded. One of more than one of the `steps` is a sequence, which ends with that step.
    """

    grade: str
    problem: str
    n: int | tuple[int, ...]
    of: int
    step: int
    settings: tuple[str, ...] = ()
    condense: bool = True
    degenerate: bool = False
    without: str = ""
    steps: int = 1

    @property
    def name(self) -> str:
        """A word with all settings but the grade."""
        ends = "-full" * (not self.condense), "-degenerate" * self.degenerate, f"-{self.without}" * bool(self.without)
        settings = "".join(f"-{setting.replace('=', '')}" for setting in self.settings)
        steps = f"{self.step - self.steps + 1}to" * (self.steps > 1) + f"{self.step}of{self.of}"
        cells = "x".join(map(str, self.n)) if isinstance(self.n, tuple) else self.n
        return f"{self.problem}-n{cells}-{steps}{settings}{''.join(ends)}"

    @property
    def run(self) -> tuple[str, tuple[int, ...], int, tuple[str, ...]]:
        """The run that it is a step of."""
        return self.problem, self.n if isinstance(self.n, tuple) else (self.n,), self.of, self.settings


SI = "young=2e11", "bound=4e9", "push=8e9", "press=1e7"
TINY = "young=2e-4", "bound=4e-6", "push=8e-6", "press=1e-8"
PAPER, BLOCK = "feng_han_huang", "block_in_space"

# grade, problem, cells per unit length, steps, settings
Row = tuple[str, str, tuple[int | tuple[int, ...], ...], tuple[int, ...], tuple[str, ...]]
PLAIN: tuple[str, ...] = ()
NEAR_HALF = ("poisson=0.499",), ("poisson=0.49999",), ("poisson=0.4999999",)
CONDENSED: tuple[Row, ...] = (
    ("easy", PAPER, (8, 16), (4, 8), PLAIN),
    ("easy", "frictional_hysteresis", (4, 8), (2,), PLAIN),
    ("easy", "manufactured_full_slip", (8, 16), (2,), PLAIN),
    ("sizes", PAPER, (32, 64), (4, 8), PLAIN),
    ("sizes", PAPER, (128, 256), (8,), PLAIN),
    ("bounds", "hertz_contact", (6, 12), (2, 8), PLAIN),
    ("bounds", "block_between_dies", (6, 12), (2,), PLAIN),
    ("bounds", "beam_on_a_stop", (6,), (2, 8), PLAIN),
    ("bounds", "spherical_indenter", (6,), (2, 8), PLAIN),
    ("pressure", "cattaneo_mindlin", (6,), (2, 8), PLAIN),
    ("pressure", "janssen_silo", (4,), (2, 8), PLAIN),
    ("pressure", "block_with_grain", (6, 12), (2, 8), PLAIN),
    ("soft", "rough_layer", (6, 12), (2, 8), PLAIN),
    ("viscous", "kelvin_voigt_creep", (6,), (2, 5, 8), PLAIN),
    ("sticking", "shear_lag", (6,), (2, 5, 8), PLAIN),
    ("sticking", "thermal_expansion_blocked_by_friction", (6,), (2, 5, 8), PLAIN),
    ("sticking", "l_shaped_bracket", (8, 16), (6, 8), PLAIN),
    ("bodies", "two_blocks_in_series", (6, 12), (8,), PLAIN),
    ("bodies", "pack_of_blocks", (6,), (4, 8), PLAIN),
    ("bodies", "hertz_two_cylinders", (6,), (8,), PLAIN),
    ("bodies", "press_fit", (6, 12), (8,), PLAIN),
    ("floating", "block_on_incline", (6, 12), (2,), PLAIN),
    ("floating", "bolted_joint", (6, 12), (2, 8), PLAIN),
    ("floating", "brake_pad_on_disc", (6, 12), (2, 8), PLAIN),
    *(("incompressible", PAPER, (16,), (8,), near) for near in NEAR_HALF),
    *(("units", PAPER, (8, 16), (8,), units) for units in (SI, TINY)),
    ("discs", BLOCK, (4, 8, 12, 16), (4, 8), PLAIN),
    ("discs", "circular_hysteresis", (2, 4, 6), (4, 8), PLAIN),
    ("discs", "block_dragged_along_a_curve", (3, 4), (2, 5, 8), PLAIN),
    ("discs", "twisted_pad", (4, 6), (2, 8), PLAIN),
    ("discs", "skew_joint", (4, 6), (2, 8), PLAIN),
)
ON_ALL_UNKNOWNS: tuple[Row, ...] = (
    ("sizes", PAPER, (8, 16, 32), (4, 8), PLAIN),
    ("sizes", PAPER, (64,), (8,), PLAIN),
    ("bounds", "hertz_contact", (6,), (8,), PLAIN),
    ("pressure", "block_with_grain", (6,), (8,), PLAIN),
    ("viscous", "kelvin_voigt_creep", (6,), (8,), PLAIN),
    *(("incompressible", PAPER, (16,), (8,), near) for near in NEAR_HALF),
    *(("units", PAPER, (8,), (8,), units) for units in (SI, TINY)),
    ("discs", BLOCK, (4, 8, 12), (8,), PLAIN),
    ("discs", "circular_hysteresis", (4,), (8,), PLAIN),
)
DEGENERATE: tuple[Row, ...] = (
    ("degenerate", "l_shaped_bracket", (8, 16), (6, 8), PLAIN),
    ("degenerate", PAPER, (16, 32), (6, 8), PLAIN),
    ("discs", BLOCK, (4, 8), (6, 8), PLAIN),
)
ON_LARGE_MESHES: tuple[Row, ...] = (
    ("large", PAPER, (128, 224, 707), (8,), PLAIN),
    ("large", BLOCK, (16, 24, 32), (8,), PLAIN),
)


def _listed(rows: tuple[Row, ...], *, of: int = 8, **more: Any) -> tuple[Instance, ...]:
    return tuple(
        Instance(grade=grade, problem=problem, n=n, of=of, step=k, settings=words, **more)
        for grade, problem, cells, steps, words in rows
        for n in cells
        for k in steps
    )


OVERLAPPED: tuple[Row, ...] = (
    ("no optimum", "hertz_contact", (6,), (8,), PLAIN),
    ("no optimum", "block_with_grain", (6,), (2,), PLAIN),
    ("no optimum", "spherical_indenter", (6,), (8,), PLAIN),
)
PUSHED: tuple[Row, ...] = (
    ("no optimum", "block_on_incline", (6,), (2,), PLAIN),
    ("no optimum", "bolted_joint", (6,), (2,), PLAIN),
    ("no optimum", "twisted_pad", (4,), (2,), PLAIN),
)
INSTANCES = (
    *_listed(CONDENSED),
    *_listed(ON_ALL_UNKNOWNS, condense=False),
    *_listed(DEGENERATE, degenerate=True),
    *_listed(OVERLAPPED, without=INFEASIBLE),
    *_listed(PUSHED, without=UNBOUNDED),
)
RUNS: tuple[tuple[str, int], ...] = ((PAPER, 32), ("block_with_grain", 6), (BLOCK, 4))
SEQUENCES = _listed(tuple(("sequences", name, (n,), (256,), PLAIN) for name, n in RUNS), of=256, steps=256)
"""Of absolute values, of Coulomb's weights beside bounds, and of discs."""
LARGE = _listed(ON_LARGE_MESHES, condense=False)
"""Instances that are written on demand only: minutes, and a gigabyte."""
CONTACTS = (9, 9, 2), (19, 19, 2), (49, 49, 2), (99, 99, 1)
DRAGGED: Row = (FCLIB, "block_dragged_along_a_curve", CONTACTS, (8,), ("crown=0.0005",))
COULOMB = _listed((DRAGGED,), of=16384, steps=8, condense=False)
"""Coulomb's law on 100 to 10,000 contacts, of which some stick, some slip and some are open; on demand."""


FEWER = dict.fromkeys(("easy", "soft", "viscous", "units", "incompressible"), 2) | {"discs": 6}


def _core() -> frozenset[str]:
    """Three instances of every grade, evenly from its first to its last; two where they differ little, six of discs."""
    found: list[str] = []
    for grade in dict.fromkeys(one.grade for one in INSTANCES):
        own, k = [one.name for one in INSTANCES if one.grade == grade], FEWER.get(grade, 3)
        found += [own[round(i * (len(own) - 1) / (k - 1))] for i in range(k)]
    return frozenset(found)


CORE = _core()
"""Names of the instances for a coffee break."""
