"""What reading, converting and writing meshes say: errors that begin with their subject, and notes as warnings."""

from __future__ import annotations

import contextlib
import io
import warnings
from collections.abc import Callable, Iterator

from vemcvx.errors import MeshError, MeshWarning
from vemcvx.meshes.checks.face_names import extreme_faces
from vemcvx.meshes.checks.names import WHOLE, straight_sides
from vemcvx.meshes.space_tessellation import SpaceTessellation
from vemcvx.meshes.tessellation import Tessellation

Found = Tessellation | SpaceTessellation


def finished(subject: str, made: Callable[[], tuple[Found, list[str]]]) -> Found:
    """The mesh of a file or an object, its sides named if nothing is; what is to be said of it as warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh, notes = made()
    if isinstance(mesh, Tessellation):
        sides = straight_sides(mesh.points, mesh.boundaries[WHOLE])
    else:
        sides = extreme_faces(mesh.points, mesh.faces)
    if sides and set(mesh.boundaries) == {WHOLE}:
        mesh = mesh.with_boundaries(sides)
        notes = [*notes, f"no part of the boundary has a name; by their place, sides are called {', '.join(sides)}."]
    for note in [*(str(warning.message) for warning in caught if warning.category is MeshWarning), *notes]:
        warnings.warn(f"{subject}: {note}", MeshWarning, stacklevel=4)
    return mesh


@contextlib.contextmanager
def translated(subject: str, failure: str) -> Iterator[None]:
    """Turn whatever other libraries do on failure, sys.exit included, into a MeshError, and keep the terminal clean."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except MeshError as error:
        raise MeshError(f"{subject} {failure}: {error}") from None
    except (SystemExit, Exception) as error:
        cause = said.getvalue() if isinstance(error, SystemExit) else f"{type(error).__name__}: {error}"
        raise MeshError(f"{subject} {failure} ({' '.join(cause.split())[:200]}).") from error


@contextlib.contextmanager
def named(subject: str) -> Iterator[None]:
    """Put the subject before the message of a MeshError."""
    try:
        yield
    except MeshError as error:
        raise MeshError(f"{subject}: {error}") from None
