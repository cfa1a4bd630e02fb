"""The reference: all public names by topic, one page a topic, from the docstrings."""

from __future__ import annotations

import importlib
import inspect
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType


@dataclass(frozen=True)
class Topic:
    """A page of the reference: its names stand in the order in which one meets them."""

    title: str
    sentence: str
    names: str
    """Qualified by their module below `vemcvx`, separated by spaces."""
    returned: str = ""
    """Classes that are no public names, but are what public names return: their module below `vemcvx`, and name."""
    modules: str = ""
    """Modules below `vemcvx` whose head has the mathematics or the table that docstrings point to."""


NAMESPACES = {
    "": "vemcvx",
    "meshes": "vemcvx.meshes",
    "measures": "vemcvx.estimate.measures",
    "plots": "vemcvx.plots",
    "program": "vemcvx.program",
    "effects": "vemcvx.effects",
    "vem": "vemcvx.vem",
    "testing": "vemcvx.testing",
}
"""Modules whose `__all__` is public, by the name under which they stand here."""
TOPICS = {
    "simulation": Topic(
        "Simulation",
        "A scene on a mesh, stepped through time; and the convex programs of its steps.",
        "Scene simulate projected programs instants march __version__",
        modules="stepping.backward_euler",
    ),
    "results": Topic(
        "Results",
        "What a run leaves: displacements, contact, stresses, energies, certificates, files, tables.",
        "History read_history joined Contact Trajectory Quantity quantities",
        returned="results.quoted.Extreme results.probe.Profile",
        modules="results.probe results.files results.corners",
    ),
    "materials": Topic(
        "Materials",
        "Elasticity, with viscosity and stresses that are there at zero strain.",
        "Elasticity Orthotropic Stabilisation Viscosity ThermalStrain Prestress",
    ),
    "loads-and-supports": Topic(
        "Loads and supports",
        "What pulls a body, and what holds it.",
        "Traction Pressure BodyForce PointLoad Clamp PrescribedDisplacement Pretension Rigid Symmetry "
        "ElasticFoundation Tabulated",
    ),
    "contact-and-friction": Topic(
        "Contact and friction",
        "With obstacles, and between bodies where `on=` names an interface.",
        "BilateralContact UnilateralContact NormalCompliance PrescribedSlip TrescaFriction CoulombFriction Law",
        modules="solvers.newton solvers.law",
    ),
    "meshes": Topic(
        "Meshes",
        "Families of meshes in the plane and in space, mesh files, bodies that touch, refinement.",
        "PolygonMesh PolyhedralMesh meshes.Mesh meshes.squares meshes.triangles meshes.hexagons meshes.voronoi "
        "meshes.distorted meshes.nonconvex meshes.hanging meshes.l_shape meshes.ring meshes.FAMILIES meshes.cubes "
        "meshes.tetrahedra meshes.prisms meshes.kelvin meshes.voronoi3 meshes.SPACE_FAMILIES meshes.read "
        "meshes.convert meshes.plane_mesh meshes.cut meshes.bodies meshes.Interface meshes.refinement "
        "meshes.Refinement",
        returned="meshes.quality.Quality",
        modules="meshes.quality",
    ),
    "solvers": Topic(
        "Solvers",
        "Of the convex program of a step; every answer is certified, whoever gives it.",
        "Solver Newton Clarabel OSQP Direct ThroughCvxpy",
        returned="solvers.solver.Prepared",
    ),
    "linear-solvers": Topic(
        "Linear solvers",
        "Factorisations of the stiffness matrix, and what takes their place where they are too large.",
        "LinearSolver SuperLU Pardiso Iterative PETSc",
        returned="linear.factor.Factor",
    ),
    "programs": Topic(
        "Programs and certificates",
        "A step as a convex program in arrays, without mesh or physics; programs as files.",
        "StepProgram Operators Norms Limits Damping System Answer Certificate SolvedProgram read_program "
        "write_program program.QUADRATIC program.ABSOLUTE_VALUES program.BOUNDS program.SECOND_ORDER_CONES "
        "program.SQUARED_POSITIVE_PARTS Kernel programs_of_march",
        modules="program.certificate program.kernel exchange.files",
    ),
    "accuracy": Topic(
        "Errors of meshes and steps",
        "Estimates, guaranteed bounds, adaptive runs, distances between runs, orders of convergence.",
        "error_budget ErrorBudget adapt Adapted error_bound ErrorBound QuantityBound measures.convergence_table "
        "measures.ConvergenceTable measures.Measured measures.energy_error measures.l2_error measures.Field "
        "measures.energy_distance measures.orders measures.Orders",
        modules="estimate.budget estimate.measures.distance",
    ),
    "plots": Topic(
        "Pictures",
        "Of results; each function returns matplotlib's axes or figure.",
        "plots.deformed_mesh plots.stressed_body plots.deformed_body plots.contact_face plots.along_contact "
        "plots.friction_traction plots.friction_disc plots.stick_slip_map plots.hysteresis_loop "
        "plots.forces_over_time plots.energy_ledger "
        "plots.wear plots.error_map plots.animate plots.write_plots",
        modules="plots.style",
    ),
    "own-effects": Topic(
        "Effects of one's own",
        "What a class returns to be an effect: arrays over the nodes of a space.",
        "Effect effects.Contribution effects.Load effects.Support effects.Obstacle effects.Friction "
        "effects.ContactSurface effects.MaterialLaw effects.Material effects.Eigenstrain effects.InitialStress",
    ),
    "virtual-elements": Topic(
        "Virtual elements",
        "The space of lowest order on polygons and polyhedra, its matrices, strains and stresses.",
        "vem.Space vem.Part vem.BoundaryRows vem.CellGroup vem.EdgeEnds vem.MirrorPlanes vem.SideRule vem.stiffness "
        "vem.stiffness_of vem.SumOverCells vem.elastic_matrix vem.softest_shear "
        "vem.mean_shear vem.VertexWeights vem.InRegions "
        "vem.stabilisation_of vem.consistent_blocks vem.energy_rows vem.cell_energies vem.missed_energies "
        "vem.mean_strains vem.cell_load vem.cell_quadrature vem.edge_load vem.edge_part vem.stress_load vem.strains "
        "vem.stresses vem.isotropic_stress vem.equivalent vem.principal vem.component_names vem.tractions "
        "vem.tangents_of vem.mean_weights "
        "vem.rigid_modes vem.split_motion vem.solid_places vem.upper_triangle",
        modules="vem.elasticity vem.tensors",
    ),
    "testing": Topic(
        "Tests of one's own effects and solvers",
        "What every solver, linear solver and effect must satisfy, for pytest.",
        "testing.effect_suite testing.EffectSample testing.Other testing.solver_suite testing.linear_suite "
        "testing.Instance testing.INSTANCES",
    ),
    "exceptions": Topic(
        "Exceptions and warnings",
        "Each names its subject, what was found, what exists, and what to do next.",
        "VemcvxError SceneError MeshError ProblemError ProgramError HistoryError NotAccepted NotCertified "
        "SolverFailed SceneWarning MeshWarning",
    ),
}


def public_names() -> list[str]:
    """All public names, qualified as in `TOPICS`: those of `vemcvx` itself are not repeated in its modules."""
    package = importlib.import_module("vemcvx")
    own = [name for name in package.__all__ if not isinstance(getattr(package, name), ModuleType)]
    modules = {short: importlib.import_module(module) for short, module in NAMESPACES.items() if short}
    others = [(short, name) for short, module in modules.items() for name in module.__all__ if name not in own]
    return [*own, *(f"{short}.{name}" for short, name in others)]


def full_name(name: str) -> str:
    """The name with its module, as in `vemcvx.meshes.squares`."""
    short, _, last = name.rpartition(".")
    return f"{NAMESPACES[short]}.{last}"


PUBLIC = {name: full_name(name) for topic in TOPICS.values() for name in topic.names.split()}
RETURNED = [f"vemcvx.{name}" for topic in TOPICS.values() for name in topic.returned.split()]
MODULES = [f"vemcvx.{name}" for topic in TOPICS.values() for name in topic.modules.split()]
SHORT = {full.rpartition(".")[2]: full for full in (*RETURNED, *PUBLIC.values())}
"""Names with their modules, by how they are called here, those that are returned, and all by their last part."""


def found(full: str) -> object:
    """What a name with its module stands for."""
    module, _, last = full.rpartition(".")
    return getattr(importlib.import_module(module), last)


DESCRIBED = {full: found(full) for full in (*PUBLIC.values(), *RETURNED)}
"""What has an entry in the reference, by its name with its module."""


def write(folder: Path) -> None:
    """Write a page for every topic, and the page that lists them."""
    folder.mkdir(parents=True, exist_ok=True)
    for slug, topic in TOPICS.items():
        (folder / f"{slug}.md").write_text(_page(topic), encoding="utf-8")
    rows = "\n".join(
        f"[{topic.title}]({slug}.md)\n: {topic.sentence} {', '.join(map(_link, topic.names.split()))}\n"
        for slug, topic in TOPICS.items()
    )
    pages = "\n".join(TOPICS)
    (folder / "index.md").write_text(
        "# Reference\n\nAll public names by topic, from their docstrings, in which `vx` is `vemcvx`.\n\n"
        f"{rows}\n```{{toctree}}\n:hidden:\n\n{pages}\n```\n",
        encoding="utf-8",
    )


def _link(name: str) -> str:
    return f"{{py:obj}}`{name} <{full_name(name)}>`"


def _page(topic: Topic) -> str:
    listed = [*map(full_name, topic.names.split()), *(f"vemcvx.{name}" for name in topic.returned.split())]
    entries = "\n".join(map(_entry, listed))
    heads = [_head(f"vemcvx.{name}") for name in topic.modules.split()]
    return "\n\n".join([f"# {topic.title}", topic.sentence, f"```{{eval-rst}}\n{entries}\n```", *heads]) + "\n"


def _entry(full: str) -> str:
    thing = DESCRIBED[full]
    if inspect.isclass(thing):
        members = "" if issubclass(thing, Warning) else f"   :members:\n   :show-inheritance:\n{_inherited(thing)}"
        return f".. autoclass:: {full}\n{members}"
    return f".. autofunction:: {full}\n" if inspect.isroutine(thing) else f".. autodata:: {full}\n   :no-value:\n"


def _inherited(kind: type) -> str:
    """Members of bases that have no entry are described with the class; those of other bases stand there, once."""
    bases = [base for base in kind.__mro__[1:] if base.__module__.partition(".")[0] == "vemcvx"]
    without = [base for base in bases if not any(base is one for one in DESCRIBED.values())]
    described = [base.__name__ for base in kind.__mro__[1:] if base not in without]
    return f"   :inherited-members: {', '.join(described)}\n" if without else ""


def _head(module: str) -> str:
    """The docstring of a module below its first line, which is the heading."""
    title = (inspect.getdoc(importlib.import_module(module)) or "").partition("\n")[0].removesuffix(".")
    return f"## {title}\n\n```{{eval-rst}}\n.. automodule:: {module}\n```"
