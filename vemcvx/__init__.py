"""vemcvx: quasistatic frictional contact on polygonal meshes, posed as certified convex programs.

A scene (material, supports, loads, contact, friction) on a polygonal mesh becomes, at every backward-Euler
step, one convex program; solvers of different kinds answer it; every answer carries a certificate that does
not depend on the solver. After Feng, Han and Huang, "A virtual element method for a quasistatic frictional
contact problem"; equation numbers in this package are its.
"""

from vemcvx import meshes as meshes
from vemcvx.base.errors import HistoryError as HistoryError
from vemcvx.base.errors import MeshError as MeshError
from vemcvx.base.errors import MeshWarning as MeshWarning
from vemcvx.base.errors import NotAccepted as NotAccepted
from vemcvx.base.errors import NotCertified as NotCertified
from vemcvx.base.errors import ProblemError as ProblemError
from vemcvx.base.errors import ProgramError as ProgramError
from vemcvx.base.errors import SceneError as SceneError
from vemcvx.base.errors import SceneWarning as SceneWarning
from vemcvx.base.errors import SolverFailed as SolverFailed
from vemcvx.base.errors import VemcvxError as VemcvxError
from vemcvx.base.version import __version__ as __version__
from vemcvx.base.weight_law import Law as Law
from vemcvx.bound.error_bound import ErrorBound as ErrorBound
from vemcvx.bound.error_bound import error_bound as error_bound
from vemcvx.bound.quantity import QuantityBound as QuantityBound
from vemcvx.effects import BilateralContact as BilateralContact
from vemcvx.effects import BodyForce as BodyForce
from vemcvx.effects import Clamp as Clamp
from vemcvx.effects import CoulombFriction as CoulombFriction
from vemcvx.effects import Effect as Effect
from vemcvx.effects import ElasticFoundation as ElasticFoundation
from vemcvx.effects import Elasticity as Elasticity
from vemcvx.effects import NormalCompliance as NormalCompliance
from vemcvx.effects import Orthotropic as Orthotropic
from vemcvx.effects import PointLoad as PointLoad
from vemcvx.effects import PrescribedDisplacement as PrescribedDisplacement
from vemcvx.effects import Pressure as Pressure
from vemcvx.effects import Prestress as Prestress
from vemcvx.effects import Symmetry as Symmetry
from vemcvx.effects import Tabulated as Tabulated
from vemcvx.effects import ThermalStrain as ThermalStrain
from vemcvx.effects import Traction as Traction
from vemcvx.effects import TrescaFriction as TrescaFriction
from vemcvx.effects import UnilateralContact as UnilateralContact
from vemcvx.effects import Viscosity as Viscosity
from vemcvx.estimate import measures as measures
from vemcvx.estimate.adapt import Adapted as Adapted
from vemcvx.estimate.adapt import adapt as adapt
from vemcvx.estimate.budget import ErrorBudget as ErrorBudget
from vemcvx.estimate.budget import error_budget as error_budget
from vemcvx.estimate.quantities import quantities as quantities
from vemcvx.exchange import read_program as read_program
from vemcvx.exchange import write_program as write_program
from vemcvx.history import History as History
from vemcvx.history import read_history as read_history
from vemcvx.linear import Iterative as Iterative
from vemcvx.linear import LinearSolver as LinearSolver
from vemcvx.linear import Pardiso as Pardiso
from vemcvx.linear import PETSc as PETSc
from vemcvx.linear import SuperLU as SuperLU
from vemcvx.meshes import PolygonMesh as PolygonMesh
from vemcvx.meshes import PolyhedralMesh as PolyhedralMesh
from vemcvx.program import Answer as Answer
from vemcvx.program import Certificate as Certificate
from vemcvx.program import Damping as Damping
from vemcvx.program import Kernel as Kernel
from vemcvx.program import Limits as Limits
from vemcvx.program import Norms as Norms
from vemcvx.program import Operators as Operators
from vemcvx.program import SolvedProgram as SolvedProgram
from vemcvx.program import StepProgram as StepProgram
from vemcvx.program import System as System
from vemcvx.results.contact import Contact as Contact
from vemcvx.results.quoted import Quantity as Quantity
from vemcvx.scene import Scene as Scene
from vemcvx.simulation import instants as instants
from vemcvx.simulation import programs as programs
from vemcvx.simulation import projected as projected
from vemcvx.simulation import simulate as simulate
from vemcvx.solvers import OSQP as OSQP
from vemcvx.solvers import Clarabel as Clarabel
from vemcvx.solvers import Direct as Direct
from vemcvx.solvers import Newton as Newton
from vemcvx.solvers import Solver as Solver
from vemcvx.solvers import ThroughCvxpy as ThroughCvxpy
from vemcvx.stepping import Trajectory as Trajectory
from vemcvx.stepping import march as march
from vemcvx.stepping import programs_of_march as programs_of_march
from vemcvx.vem import Stabilisation as Stabilisation

__all__ = sorted(
    {"__version__", "measures", "meshes"}
    | {name for name, thing in list(globals().items()) if callable(thing) and not name.startswith("_")}
)
