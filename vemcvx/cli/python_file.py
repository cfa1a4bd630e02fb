"""A Python file of the user's: executed, with errors of its own making named by file and line."""

from __future__ import annotations

import ast
import importlib.util
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from vemcvx.errors import ProblemError, VemcvxError


def executed(path: Path, kind: str) -> ModuleType:
    """Execute a file; `kind` is what it is called in messages, as "problem file".

    Raises
    ------
    ProblemError
        There is no such file, it is no Python, or it fails.
    """
    if not os.path.isfile(path):
        here = ", ".join(sorted(str(p) for p in [*Path().glob("*.py"), *Path("problems").glob("*.py")])[:8])
        raise ProblemError(f"{path}: there is no such {kind}; here are {here or 'no Python files'}.")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise ProblemError(f"{path}: a {kind} is Python and ends in .py.")
    module, loader = importlib.util.module_from_spec(spec), spec.loader
    with _neighbours(path):
        # Dataclasses look their module up by name.
        sys.modules[spec.name] = module
        own_errors(path, "executing it", lambda: loader.exec_module(module))
    return module


def own_errors(path: Path, what: str, action: Callable[[], Any]) -> Any:
    """Do what a user's file asks for; an error of its own making is named with its line."""
    try:
        return action()
    except VemcvxError:
        raise
    except (Exception, SystemExit) as error:
        lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
        where = f", line {lines[-1]}" if lines else ""
        words = " ".join(str(error).split())
        raise ProblemError(f"{path}{where}: {what} failed: {type(error).__name__}: {words}") from error


def literal(text: str) -> Any:
    """What Python reads in the words of an option; the words themselves where it reads nothing."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):
        return text


@contextmanager
def _neighbours(path: Path) -> Iterator[None]:
    """Let a file import those beside it, as `python FILE` does."""
    folder = str(path.resolve().parent)
    sys.path.insert(0, folder)
    try:
        yield
    finally:
        sys.path.remove(folder)
