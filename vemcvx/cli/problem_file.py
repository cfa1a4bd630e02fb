"""Python files of the user: problem files, executed, with errors of their own making named by file and line."""

from __future__ import annotations

import ast
import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from inspect import cleandoc
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from vemcvx.base.arrays import Floats, brief
from vemcvx.base.errors import ProblemError, VemcvxError
from vemcvx.cli.supplied import problem_path
from vemcvx.effects.effect import amount, where
from vemcvx.history import History
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES, Mesh, PolygonMesh, PolyhedralMesh, read
from vemcvx.plots.style import Units, checked_units
from vemcvx.scene import Scene
from vemcvx.simulation import simulate
from vemcvx.solvers import Solver
from vemcvx.stepping import check_times

if TYPE_CHECKING:
    from vemcvx.estimate.adapt import Adapted


def executed(path: Path, kind: str) -> ModuleType:
    """Execute a file; `kind` is its name in messages, such as "problem file"; ProblemError where it fails."""
    if not os.path.isfile(path):
        here = ", ".join(sorted(str(p) for p in [*Path().glob("*.py"), *Path("problems").glob("*.py")])[:8])
        raise ProblemError(f"{path}: there is no such {kind}; here are {here or 'no Python files'}.")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ProblemError(f"{path}: a {kind} is Python and ends in .py.")
    module, loader = importlib.util.module_from_spec(spec), spec.loader
    # Dataclasses look their module up by name, and a file may import those beside it, as `python FILE` does.
    sys.modules[spec.name] = module
    sys.path.insert(0, folder := str(path.resolve().parent))
    try:
        own_errors(path, "executing it", lambda: loader.exec_module(module))
    finally:
        sys.path.remove(folder)
    return module


def own_errors(path: Path, what: str, action: Callable[[], Any], wanted: str = "") -> Any:
    """Do what a user's file asks for; an error of its own making is named with its line, and with what is `wanted`."""
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
            wanted += "; what a file imports is installed, or stands beside it"
        raise ProblemError(f"{path}{where}: {what} failed: {type(error).__name__}: {words}{wanted}") from error


def literal(text: str) -> Any:
    """The Python literal that an option's words spell, or the words themselves."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return text


def several(text: str) -> list[str]:
    """The values, as they are spelt, between commas that stand in no brackets and no quotes."""
    try:
        body = ast.parse(text, mode="eval").body
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        # Words such as steel,rubber-2; where brackets or quotes are in them, they are one.
        return [text] if re.search(r"[\[({'\"]", text) else [word for word in text.split(",") if word] or [text]
    if not isinstance(body, ast.Tuple) or not body.elts or body.elts[0].col_offset > body.col_offset:
        return [text]
    return [ast.get_source_segment(text, one) or "" for one in body.elts]


SPACE_N = 8  # Cells across the shortest side when nobody says how many, in space: 64 would be 262,144 cubes.
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

    def simulated(self, **options: Any) -> History:
        """Return the history on this mesh and at these instants."""
        return simulate(self.scene, self.mesh, self.times, solver=self.solver, initial=self.initial, **options)

    def adapted(self, instants: Floats, target: float, **options: Any) -> Adapted:
        """Return the history on a mesh adapted from this one, which has these instants and the first."""
        from vemcvx.estimate.adapt import adapt

        wanted = np.append(self.times[0], instants)
        return adapt(self.scene, self.mesh, wanted, target, solver=self.solver, initial=self.initial, **options)


@dataclass(frozen=True)
class Problem:
    """A problem file: its scene, mesh, times, initial state, and names of units."""

    path: Path
    module: ModuleType

    @property
    def name(self) -> str:
        """The name of the file, without its suffix."""
        return self.path.stem

    @property
    def title(self) -> str:
        """The first line of its docstring."""
        return f"{self.module.__doc__ or ''}\n{self.name}".strip().splitlines()[0]

    @property
    def text(self) -> str:
        """The docstring below that line."""
        return "\n".join(cleandoc(f"{self.module.__doc__ or ''}").splitlines()[1:])

    def parameters(self, settings: Sequence[str] = ()) -> list[tuple[str, str]]:
        """The parameters of the scene with their values in words: those given as "name=value", else their defaults."""
        given = self._given(settings)
        own = self._signature()
        known = {name: one.default for name, one in own.items() if one.kind is not one.VAR_KEYWORD}
        return [(n, repr(v) if isinstance(v, str) else amount(v)) for n, v in (known | given).items()]

    def studied(self, settings: Sequence[str]) -> list[tuple[str, ...]]:
        """All combinations of values where settings "name=value,value" have several, the last setting fastest.

        Where the scene's own value is a tuple or a list, numbers with commas between are one such value, as brackets
        around them say anywhere; several values are in brackets then.
        """
        choices: dict[str, list[str]] = {}
        for setting, (name, value) in zip(settings, self._given(settings).items(), strict=True):
            default = self._signature().get(name)
            rows = isinstance(value, tuple) and all(isinstance(one, (tuple, list)) for one in value)
            single = default is not None and isinstance(default.default, (tuple, list)) and not rows
            text = setting.partition("=")[2]
            choices[name] = [text] if single else several(text)
            if twice := [one for one, count in Counter(choices[name]).items() if count > 1]:
                raise ProblemError(f"--set: {name} is {twice[0]} twice in {setting!r}; give each value once.")
        return [
            tuple(f"{name}={value}" for name, value in zip(choices, each, strict=True))
            for each in product(*choices.values())
        ]

    def scene(self, settings: Sequence[str] = ()) -> Scene:
        """The scene, with parameters given as "name=value"."""
        return self._call("scene", **self._given(settings, "scene"))

    @property
    def has_stages(self) -> bool:
        """True if the file defines stages, which `run` and `show` take in place of scene and times."""
        return callable(getattr(self.module, "stages", None))

    def stages(self, settings: Sequence[str] = ()) -> list[tuple[Scene, Floats]]:
        """The scene and the instants of every stage, with parameters given as "name=value"."""
        made = self._call("stages", **self._given(settings, "stages"))
        try:
            found = [(scene, check_times(times)) for scene, times in made]
        except (TypeError, ValueError):
            found = []
        if not found or not all(isinstance(scene, Scene) for scene, _ in found):
            raise ProblemError(f"{self.path}: stages(...) returned {brief(made)}; wanted {RETURNS['stages']}.")
        return found

    def mesh(self, n: int | tuple[int, ...], family: str | None = None, settings: Sequence[str] = ()) -> Mesh:
        """The mesh, of the problem's own family by default; a name with a suffix is that of a mesh file.

        A file is read as several bodies if the scene of these settings names parts of bodies, such as "plate.rim", or
        interfaces, such as "plate|pin".
        """
        if family is not None and is_file(family):
            scenes = [one for one, _ in self.stages(settings)] if self.has_stages else [self.scene(settings)]
            names = [where(getattr(effect, "on", "")) for scene in scenes for effect in scene.effects]
            return read(family, bodies="physical" if any(sign in name for name in names for sign in ".|") else None)
        if family is not None and family not in (*self.families, self.family):
            known = ", ".join(self.families)
            raise ProblemError(f"--mesh: there is no family {family!r}; there are {known}, and files such as part.msh.")
        return self._call("mesh", n, **({} if family is None else {"family": family}))

    @property
    def families(self) -> tuple[str, ...]:
        """The families of meshes that the problem can take: those of space if its own is one of them."""
        return tuple(SPACE_FAMILIES if self.family in SPACE_FAMILIES else FAMILIES)

    @property
    def family(self) -> str | None:
        """The family of meshes that `mesh` takes by default, if the file names it."""
        default = inspect.signature(self.module.mesh).parameters.get("family")
        return default.default if default is not None and isinstance(default.default, str) else None

    def in_space(self, family: str | None = None) -> bool:
        """True if its bodies are of polyhedra. A family of the file's own does not say so; its mesh does."""
        known = family or self.family
        if known in FAMILIES or known in SPACE_FAMILIES:
            return known in SPACE_FAMILIES
        return not isinstance(self.mesh(SPACE_N, family), PolygonMesh)

    def usual_n(self, usual: int, family: str | None = None) -> int:
        """Cells across the shortest side when nobody says how many: as `usual` in the plane, at most 8 in space."""
        plane = usual <= SPACE_N or (family is not None and is_file(family)) or not self.in_space(family)
        return usual if plane else SPACE_N

    def times(self, steps: int) -> Any:
        """The instants; `simulate` checks them."""
        return self._call("times", steps)

    def posed(self, settings: Sequence[str], mesh: Mesh, steps: int, solver: Solver | None = None) -> Posed:
        """The arguments of `simulate` and `adapt`: the scene of these settings, this mesh, and instants of steps."""
        return Posed(self.scene(settings), mesh, check_times(self.times(steps)), solver, self.initial)

    @property
    def initial(self) -> Any:
        """The initial state, if the file names one: "settled", "equilibrium" or a displacement."""
        return getattr(self.module, "initial", None)

    @property
    def units(self) -> Units | None:
        """The names of units of the problem's data, if the file has them as UNITS."""
        return checked_units(getattr(self.module, "UNITS", None), f"{self.path}: UNITS") or None

    def _signature(self, part: str = "") -> Mapping[str, inspect.Parameter]:
        """The parameters of scene or stages; by default of stages, if there are some."""
        chosen = part or ("stages" if self.has_stages else "scene")
        return inspect.signature(getattr(self.module, chosen, lambda: None)).parameters

    def _given(self, settings: Sequence[str], part: str = "") -> dict[str, Any]:
        """The parameters that settings give, each of them once."""
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
            default = known[name].default if name in known else None
            if text.rstrip().endswith(",") and not isinstance(default, (tuple, list)):
                raise ProblemError(
                    f"--set: found {setting!r}; several values have commas between, {name}=1,2, and one has none."
                )
            given[name] = literal(text)
        return given

    def require(self, part: str) -> None:
        """Raise ProblemError if the file, which has stages, does not define this part."""
        if not callable(getattr(self.module, part, None)):
            raise ProblemError(
                f"{self.path}: it has stages and no {PARTS[part]}; only `vemcvx run` and `show` take stages. Define "
                f"{PARTS['scene']} and {PARTS['times']} beside stages() for the other commands."
            )

    def _call(self, part: str, *given: Any, **named: Any) -> Any:
        """The answer of a function of the file, checked to be of the kind that it should be."""
        self.require(part)
        words = ", ".join([*map(repr, given), *(f"{name}={value!r}" for name, value in named.items())])
        wanted = f". That is the problem file's own {part}, which is to return {RETURNS[part]}."
        made = own_errors(self.path, f"{part}({words})", lambda: getattr(self.module, part)(*given, **named), wanted)
        if not isinstance(made, KINDS[part]):
            kind = f"a vemcvx.{KINDS[part][0].__name__}"
            raise ProblemError(f"{self.path}: {part}(...) returned {brief(made)}; wanted {kind}.")
        return made


def read_problem(file: str | Path) -> Problem:
    """Execute a problem file: one that is here, or one that came with the package, by its name."""
    path = problem_path(file)
    module = executed(path, "problem file")
    needed = ("mesh",) if callable(getattr(module, "stages", None)) else tuple(PARTS)
    missing = [PARTS[name] for name in needed if not callable(getattr(module, name, None))]
    if missing:
        raise ProblemError(
            f"{path}: does not define {' nor '.join(missing)}; a problem file defines {', '.join(PARTS.values())}."
        )
    return Problem(path, module)


def is_file(family: str) -> bool:
    """Return True if what --mesh names is a file, not a family."""
    return bool(Path(family).suffix)
