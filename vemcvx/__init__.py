"""vemcvx: quasistatic frictional contact on polygonal meshes, posed as certified convex programs.

A scene (material, supports, loads, contact, friction) on a polygonal mesh becomes, at every backward-Euler
step, one convex program; solvers of different kinds answer it; every answer carries a certificate that does
not depend on the solver. After Feng, Han and Huang, "A virtual element method for a quasistatic frictional
contact problem"; equation numbers in this package are its.
"""

from vemcvx import meshes
from vemcvx.base.errors import (
    HistoryError,
    MeshError,
    MeshWarning,
    NotAccepted,
    NotCertified,
    ProblemError,
    ProgramError,
    SceneError,
    SceneWarning,
    SolverFailed,
    VemcvxError,
)
from vemcvx.base.version import __version__
from vemcvx.base.weight_law import Law
from vemcvx.bound.error_bound import ErrorBound, error_bound
from vemcvx.bound.quantity import QuantityBound
from vemcvx.effects import (
    BilateralContact,
    BodyForce,
    Clamp,
    CoulombFriction,
    Effect,
    ElasticFoundation,
    Elasticity,
    NormalCompliance,
    Orthotropic,
    PointLoad,
    PrescribedDisplacement,
    Pressure,
    Prestress,
    Symmetry,
    Tabulated,
    ThermalStrain,
    Traction,
    TrescaFriction,
    UnilateralContact,
    Viscosity,
)
from vemcvx.estimate import measures
from vemcvx.estimate.adapt import Adapted, adapt
from vemcvx.estimate.budget import ErrorBudget, error_budget
from vemcvx.estimate.quantities import quantities
from vemcvx.exchange import read_program, write_program
from vemcvx.history import History, read_history
from vemcvx.linear import Iterative, LinearSolver, Pardiso, PETSc, SuperLU
from vemcvx.meshes import PolygonMesh, PolyhedralMesh
from vemcvx.program import (
    Answer,
    Certificate,
    Damping,
    Kernel,
    Limits,
    Norms,
    Operators,
    SolvedProgram,
    StepProgram,
    System,
)
from vemcvx.results.contact import Contact
from vemcvx.results.quoted import Quantity
from vemcvx.scene import Scene
from vemcvx.simulation import instants, programs, projected, simulate
from vemcvx.solvers import OSQP, Clarabel, Direct, Newton, Solver, ThroughCvxpy
from vemcvx.stepping import Trajectory, march, programs_of_march
from vemcvx.vem import Stabilisation

__all__ = [
    "OSQP",
    "Adapted",
    "Answer",
    "BilateralContact",
    "BodyForce",
    "Certificate",
    "Clamp",
    "Clarabel",
    "Contact",
    "CoulombFriction",
    "Damping",
    "Direct",
    "Effect",
    "ElasticFoundation",
    "Elasticity",
    "ErrorBound",
    "ErrorBudget",
    "History",
    "HistoryError",
    "Iterative",
    "Kernel",
    "Law",
    "Limits",
    "LinearSolver",
    "MeshError",
    "MeshWarning",
    "Newton",
    "NormalCompliance",
    "Norms",
    "NotAccepted",
    "NotCertified",
    "Operators",
    "Orthotropic",
    "PETSc",
    "Pardiso",
    "PointLoad",
    "PolygonMesh",
    "PolyhedralMesh",
    "PrescribedDisplacement",
    "Pressure",
    "Prestress",
    "ProblemError",
    "ProgramError",
    "Quantity",
    "QuantityBound",
    "Scene",
    "SceneError",
    "SceneWarning",
    "SolvedProgram",
    "Solver",
    "SolverFailed",
    "Stabilisation",
    "StepProgram",
    "SuperLU",
    "Symmetry",
    "System",
    "Tabulated",
    "ThermalStrain",
    "ThroughCvxpy",
    "Traction",
    "Trajectory",
    "TrescaFriction",
    "UnilateralContact",
    "VemcvxError",
    "Viscosity",
    "__version__",
    "adapt",
    "error_bound",
    "error_budget",
    "instants",
    "march",
    "measures",
    "meshes",
    "programs",
    "programs_of_march",
    "projected",
    "quantities",
    "read_history",
    "read_program",
    "simulate",
    "write_program",
]
