"""Problem files are Python files that define a scene, a mesh and instants."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import cleandoc
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from vemcvx.base.arrays import Floats, brief, is_real
from vemcvx.base.errors import ProblemError, VemcvxError
from vemcvx.cli.supplied import problem_path
from vemcvx.effects.effect import amount, where
from vemcvx.history import History
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES, Mesh, PolygonMesh, PolyhedralMesh, read
from vemcvx.plots.style import check_units
from vemcvx.scene import Scene
from vemcvx.simulation import simulate
from vemcvx.solvers import Solver
from vemcvx.stepping import check_times

if TYPE_CHECKING:
    from vemcvx.estimate.adapt import Adapted


def execute_file(path: Path, kind: str) -> ModuleType:
    """Execute a Python file, called `kind` in messages, and return the module."""
    if not os.path.isfile(path):
        raise ProblemError(f"{path}: there is no such {kind}.")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ProblemError(f"{path}: a {kind} is a Python file, whose name ends in .py.")
    module, loader = importlib.util.module_from_spec(spec), spec.loader
    # Dataclasses look up the module by name. A file may import files of the same folder.
    sys.modules[spec.name] = module
    sys.path.insert(0, folder := str(path.resolve().parent))
    try:
        run_user_code(path, "executing it", lambda: loader.exec_module(module))
    finally:
        sys.path.remove(folder)
    return module


def run_user_code(path: Path, what: str, action: Callable[[], Any], wanted: str = "") -> Any:
    """Run code of a user's file, and report errors as ProblemError with file and line."""
    try:
        return action()
    except VemcvxError:
        raise
    except (Exception, SystemExit) as error:
        frames, own = traceback.extract_tb(error.__traceback__), str(Path.cwd() / path)
        lines = [frame.lineno for frame in frames if frame.filename in (own, str(path))]
        where = f", line {lines[-1]}" if lines else ""
        words = " ".join(str(error).split())
        if isinstance(error, ModuleNotFoundError):
            wanted += "; modules that a file imports must be installed, or be in the folder of the file"
        raise ProblemError(f"{path}{where}: {what} failed: {type(error).__name__}: {words}{wanted}") from error


def parse_literal(text: str) -> Any:
    """Return the value of a Python literal, or the text if it is no literal."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return text


def split_values(text: str) -> list[str]:
    """Split a text at commas outside brackets."""
    return [part.strip() for part in re.split(r",(?![^(\[]*[)\]])", text) if part.strip()] or [text]


SPACE_N = 8  # In space, the default number of cells across the shortest side.
# Function of a problem file -> signature (PARTS), types of the result (KINDS), result in words (RETURNS).
PARTS = {"scene": "scene(**parameters)", "mesh": 'mesh(n, family="squares")', "times": "times(steps)"}
KINDS = {"scene": (Scene,), "mesh": (PolygonMesh, PolyhedralMesh), "times": (object,), "stages": (object,)}
RETURNS = {
    "scene": "a vemcvx.Scene",
    "mesh": "a mesh for every number n of cells across the shortest side",
    "times": "instants for every number of steps",
    "stages": "a list of (scene, times), one for each stage",
}


@dataclass(frozen=True, eq=False)
class Posed:
    """The arguments of `simulate` and `adapt` for one run."""

    scene: Scene
    mesh: Mesh
    times: Floats
    solver: Solver | None = None
    initial: Any = None

    def simulate(self, **options: Any) -> History:
        """Return the history on this mesh and at these instants."""
        return simulate(self.scene, self.mesh, self.times, solver=self.solver, initial=self.initial, **options)

    def adapt(self, instants: Floats, target: float, **options: Any) -> Adapted:
        """Return an adaptive run through the initial instant and `instants`."""
        from vemcvx.estimate.adapt import adapt

        wanted = np.append(self.times[0], instants)
        return adapt(self.scene, self.mesh, wanted, target, solver=self.solver, initial=self.initial, **options)


@dataclass(frozen=True)
class Problem:
    """A problem file: its scene, mesh, instants, initial state, and names of units."""

    path: Path
    module: ModuleType

    @property
    def name(self) -> str:
        """The name of the file, without its suffix."""
        return self.path.stem

    @property
    def title(self) -> str:
        """The first line of the file's docstring."""
        return f"{self.module.__doc__ or ''}\n{self.name}".strip().splitlines()[0]

    @property
    def text(self) -> str:
        """The docstring without the first line."""
        return "\n".join(cleandoc(f"{self.module.__doc__ or ''}").splitlines()[1:])

    def parameters(self, settings: Sequence[str] = ()) -> list[tuple[str, str]]:
        """Return the names and values of parameters as words."""
        values = self._values(settings).items()
        return [(n, repr(v) if isinstance(v, str) else amount(v)) for n, v in values]

    def numbers(self, settings: Sequence[str] = ()) -> dict[str, float]:
        """Return the numerical parameters of the scene."""
        return {name: float(value) for name, value in self._values(settings).items() if is_real(value)}

    def _values(self, settings: Sequence[str]) -> dict[str, Any]:
        own, given = self._signature(), self._parse_settings(settings)
        return {name: one.default for name, one in own.items() if one.kind is not one.VAR_KEYWORD} | given

    def combine_settings(self, settings: Sequence[str]) -> list[tuple[str, ...]]:
        """Return all combinations of values in settings "name=value,value"."""
        self._parse_settings(settings)
        typed = [setting.partition("=") for setting in settings]
        return list(product(*(dict.fromkeys(f"{name}={x}" for x in split_values(text)) for name, _, text in typed)))

    def scene(self, settings: Sequence[str] = ()) -> Scene:
        """Return the scene with the parameters in settings "name=value"."""
        return self._call("scene", **self._parse_settings(settings, "scene"))

    @property
    def has_stages(self) -> bool:
        """True if the file defines the function `stages`."""
        return callable(getattr(self.module, "stages", None))

    def stages(self, settings: Sequence[str] = ()) -> list[tuple[Scene, Floats]]:
        """Return the scene and the instants of every stage."""
        made = self._call("stages", **self._parse_settings(settings, "stages"))
        try:
            found = [(scene, check_times(times)) for scene, times in made]
        except (TypeError, ValueError):
            found = []
        if not found or not all(isinstance(scene, Scene) for scene, _ in found):
            raise ProblemError(f"{self.path}: stages(...) returned {brief(made)}; wanted {RETURNS['stages']}.")
        return found

    def mesh(self, n: int | tuple[int, ...], family: str | None = None, settings: Sequence[str] = ()) -> Mesh:
        """Return a mesh from a family, from a file, or by default from the function `mesh`."""
        if family is not None and is_file(family):
            scenes = [one for one, _ in self.stages(settings)] if self.has_stages else [self.scene(settings)]
            # Boundaries of several bodies have names such as "plate.rim" and "plate|pin".
            names = [where(getattr(effect, "on", "")) for scene in scenes for effect in scene.effects]
            return read(family, bodies="physical" if any(sign in name for name in names for sign in ".|") else None)
        if family is not None and family not in (*self.families, self.family):
            known = ", ".join(self.families)
            raise ProblemError(f"--mesh: there is no family {family!r}; there are {known}, and files such as part.msh.")
        return self._call("mesh", n, **({} if family is None else {"family": family}))

    @property
    def families(self) -> tuple[str, ...]:
        """The mesh families in the dimension of the problem."""
        return tuple(SPACE_FAMILIES if self.family in SPACE_FAMILIES else FAMILIES)

    @property
    def family(self) -> str | None:
        """The default family of the function `mesh`, or None."""
        default = inspect.signature(self.module.mesh).parameters.get("family")
        return default.default if default is not None and isinstance(default.default, str) else None

    def in_space(self, family: str | None = None) -> bool:
        """Return True if the mesh consists of polyhedra."""
        known = family or self.family
        if known in FAMILIES or known in SPACE_FAMILIES:
            return known in SPACE_FAMILIES
        return not isinstance(self.mesh(SPACE_N, family), PolygonMesh)

    def default_n(self, in_plane: int, family: str | None = None) -> int:
        """Return the default number of cells across the shortest side."""
        plane = in_plane <= SPACE_N or (family is not None and is_file(family)) or not self.in_space(family)
        return in_plane if plane else SPACE_N

    def times(self, steps: int) -> Floats:
        """Return the instants for a number of steps."""
        return check_times(self._call("times", steps))

    def pose(self, settings: Sequence[str], mesh: Mesh, steps: int, solver: Solver | None = None) -> Posed:
        """Return the arguments of `simulate` for settings, a mesh and a number of steps."""
        return Posed(self.scene(settings), mesh, self.times(steps), solver, self.initial)

    @property
    def initial(self) -> Any:
        """The initial state, if the file defines one: "settled", "equilibrium" or a displacement."""
        return getattr(self.module, "initial", None)

    @property
    def units(self) -> dict[str, str] | None:
        """The names of units, if the file defines UNITS."""
        return dict(check_units(getattr(self.module, "UNITS", None), f"{self.path}: UNITS")) or None

    def _signature(self, part: str = "") -> Mapping[str, inspect.Parameter]:
        """Return the parameters of the function `part`, by default of `stages` or `scene`."""
        chosen = part or ("stages" if self.has_stages else "scene")
        return inspect.signature(getattr(self.module, chosen, lambda: None)).parameters

    def _parse_settings(self, settings: Sequence[str], part: str = "") -> dict[str, Any]:
        known, given = self._signature(part), dict[str, Any]()
        any_name = any(parameter.kind is parameter.VAR_KEYWORD for parameter in known.values())
        for setting in settings:
            name, equals, text = setting.partition("=")
            if not equals:
                raise ProblemError(f"--set: found {setting!r}; wanted name=value, such as {next(iter(known), 'a')}=1.")
            if name not in known and not any_name:
                there_are = ", ".join(map(str, known.values())) or "none"
                raise ProblemError(f"--set: {self.path} has no parameter {name!r}; its scene has {there_are}.")
            if name in given:
                raise ProblemError(f"--set: {name} is given twice; give several values in one --set, {name}=1,2.")
            given[name] = parse_literal(text)
        return given

    def require(self, part: str) -> None:
        """Raise ProblemError if the file does not define the function `part`."""
        if not callable(getattr(self.module, part, None)):
            raise ProblemError(
                f"{self.path}: it has stages and no {PARTS[part]}; only `vemcvx run` and `show` take stages. Define "
                f"{PARTS['scene']} and {PARTS['times']}, too."
            )

    def _call(self, part: str, *given: Any, **named: Any) -> Any:
        self.require(part)
        words = ", ".join([*map(repr, given), *(f"{name}={value!r}" for name, value in named.items())])
        wanted = f". The function {part} of the problem file must return {RETURNS[part]}."
        made = run_user_code(self.path, f"{part}({words})", lambda: getattr(self.module, part)(*given, **named), wanted)
        if not isinstance(made, KINDS[part]):
            kind = f"a vemcvx.{KINDS[part][0].__name__}"
            raise ProblemError(f"{self.path}: {part}(...) returned {brief(made)}; wanted {kind}.")
        return made


def read_problem(file: str | Path) -> Problem:
    """Read a problem file, given by path, or by name if the package contains it."""
    path = problem_path(file)
    module = execute_file(path, "problem file")
    needed = ("mesh",) if callable(getattr(module, "stages", None)) else tuple(PARTS)
    missing = [PARTS[name] for name in needed if not callable(getattr(module, name, None))]
    if missing:
        wanted = ", ".join(PARTS.values())
        raise ProblemError(f"{path}: does not define {' nor '.join(missing)}; a problem file defines {wanted}.")
    return Problem(path, module)


def is_file(family: str) -> bool:
    """Return True if a value of --mesh is a file, not a family."""
    return bool(Path(family).suffix)


def mesh_name(problem: Problem, family: str | None, n: int) -> str:
    """Return the name of a mesh file, or a family name with the number n."""
    name = family or problem.family or "the problem's own"
    return name if is_file(name) else f"{name}, n = {n}"
