"""The small strains of a run: where they are left, by how much, and what is the likely cause.

Linear elasticity and contact between the nodes that lie opposite at the start hold while strains, turns and slips are
small. A run that leaves them is answered, and certified, all the same, as when Young's modulus is given in GPa and
loads in MPa. Looked at are 16 stored instants at most, that of the largest energy among them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes import AnyMesh, PolygonMesh
from vemcvx.meshes.polygons import smallest_linked
from vemcvx.outline import coordinates
from vemcvx.results.results import Results
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.scene import InitialStresses
from vemcvx.vem import Space, principal, strains

LARGEST_STRAIN = 0.05
"""Strains, and displacements in parts of the body, up to which squares of strains, .1 % of one, are left out."""


def warning(posed: PosedScene, results: Results) -> str:
    """A sentence on what is largest and where, if small strains are left; else empty."""
    count = len(results.stored)
    energies = results.energy
    rows = np.unique([*np.linspace(0, count - 1, min(16, count)).astype(int), int(np.argmax(energies))])
    found = [*_strains(posed.space, results, rows), *_motions(results, rows), *_slips(results, rows)]
    if not found:
        return ""
    return f"small strains are left: {'; '.join(found)}. {_cause(posed)}"


def _strains(space: Space, results: Results, rows: Ints) -> Iterator[str]:
    """The largest principal strain, at the instant of the largest energy."""
    row = int(rows[np.argmax(results.energy[rows])])
    strain = strains(space, results.displacement[row])
    tensor = strain.copy()
    tensor[:, space.dim :] *= 0.5
    size, mesh = np.abs(principal(tensor)).max(axis=1), space.mesh
    volumes = mesh.areas if isinstance(mesh, PolygonMesh) else mesh.volumes
    k = int(np.argmax(size))
    # At a singular corner some strain is that large, if only the mesh is fine.
    if volumes[size > LARGEST_STRAIN].sum() > 0.01 * volumes.sum():
        yield f"a strain of {size[k]:.2g} {_where(results, mesh.centroids[k], row)}"


def _motions(results: Results, rows: Ints) -> Iterator[str]:
    """The largest difference of displacements in a body, by components: what all of it moves by strains nothing."""
    mesh = results.mesh
    body = _bodies(mesh)
    order = np.argsort(body, kind="stable")
    begin = np.flatnonzero(np.diff(body[order], prepend=-1))

    def extent(values: Floats) -> Floats:
        """(bodies,) the diagonal of the box around values (n_nodes, dim) of each body."""
        low, high = (of.reduceat(values[order], begin, axis=0) for of in (np.minimum, np.maximum))
        found: Floats = np.linalg.norm(high - low, axis=1)
        return found

    size = extent(mesh.points)
    apart = np.array([extent(results.displacement[row]) for row in rows.tolist()])
    at, one = np.unravel_index(np.argmax(apart / size), apart.shape)
    if apart[at, one] > LARGEST_STRAIN * size[one]:
        nodes, row = order[begin[one] :][: np.sum(body == body[order[begin[one]]])], int(rows[at])
        u = results.displacement[row][nodes]
        k = nodes[np.argmax(np.linalg.norm(u - np.median(u, axis=0), axis=1))]
        words = f"displacements that differ by {apart[at, one]:.3g} in a body of the size {size[one]:.3g}"
        yield f"{words}, the largest {_where(results, mesh.points[k], row)}"


def _slips(results: Results, rows: Ints) -> Iterator[str]:
    """The largest slip between two bodies, in edges of their contact: nodes no longer face those they press on."""
    contact, joined = results.contact, np.flatnonzero(results.contact.partners >= 0)
    if len(joined) == 0:
        return
    edge = contact.lengths[joined] ** (1.0 / (contact.points.shape[1] - 1))
    slip = np.linalg.norm(contact.slip[rows][:, joined], axis=2)
    row, k = np.unravel_index(np.argmax(slip / edge), slip.shape)
    if slip[row, k] > edge[k]:
        yield (
            f"a slip of {slip[row, k]:.3g} between bodies whose edges of contact there are {edge[k]:.3g} long "
            f"{_where(results, contact.points[joined[k]], int(rows[row]))}"
        )


def _bodies(mesh: AnyMesh) -> Ints:
    """A number (n_nodes,) for each node, the same for all of one connected body."""
    if isinstance(mesh, PolygonMesh):
        offsets, chain = mesh.offsets, mesh.vertices
    else:
        offsets, chain = mesh.face_offsets, mesh.face_vertices
    first = np.repeat(chain[offsets[:-1]], np.diff(offsets))
    return smallest_linked(np.column_stack([first, chain]), mesh.n_nodes)


def _where(results: Results, place: Floats, row: int) -> str:
    return f"at {coordinates(place)}, t = {float(results.times[row]):.6g}"


def _cause(posed: PosedScene) -> str:
    """The likely cause: moduli against loads, or what is prescribed against lengths."""
    if any(not isinstance(load, InitialStresses) for load in posed.loads):
        return "Probably young and the loads are in different units, as GPa and MPa: compare them."
    return "Probably what is prescribed (displacements, gaps) and the mesh are in different units: compare them."
