"""The convex program of a step: condensation, scaling and certificate.

Authors of solvers need `Operators`, `StepProgram`, `Answer`, and the names of features.
"""

from vemcvx.program.certificate import Certificate
from vemcvx.program.kernel import Kernel
from vemcvx.program.operators import (
    ABSOLUTE_VALUES,
    BOUNDS,
    QUADRATIC,
    SECOND_ORDER_CONES,
    SQUARED_POSITIVE_PARTS,
    Operators,
)
from vemcvx.program.step_program import Answer, SolvedProgram, StepProgram
from vemcvx.program.system import Damping, Limits, Norms, System

__all__ = [
    "ABSOLUTE_VALUES",
    "BOUNDS",
    "QUADRATIC",
    "SECOND_ORDER_CONES",
    "SQUARED_POSITIVE_PARTS",
    "Answer",
    "Certificate",
    "Damping",
    "Kernel",
    "Limits",
    "Norms",
    "Operators",
    "SolvedProgram",
    "StepProgram",
    "System",
]
