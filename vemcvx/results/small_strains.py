"""The small strains of a run: where they are left, by how much, and what is the likely cause.

Linear elasticity and contact between the nodes that lie opposite at the start hold while strains, turns and slips are
small. A run that leaves them is answered, and certified, all the same, as when Young's modulus is given in GPa and
loads in MPa. Looked at are 16 stored instants at most, that of the largest energy among them.

A body that is a tenth shorter is past the linear model, and nothing is wrong with its units. Those are suspected where
strains, or displacements in parts of the body, are of the order of one; and then in what does most of the work, for

    a(u, u) = f . u + F . u + s . u

with the loads f, the forces F of supports and contact and the load s of initial stresses, by virtual work with u.
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
Found = tuple[float, str]  # A strain, or a displacement in parts of the body, and what to say of it.


def warning(posed: PosedScene, results: Results) -> str:
    """A sentence on what is largest and where, if small strains are left; else empty."""
    count = len(results.stored)
    energies = results.energy
    rows = np.unique([*np.linspace(0, count - 1, min(16, count)).astype(int), int(np.argmax(energies))])
    found = [*_strains(posed.space, results, rows), *_motions(results, rows), *_slips(results, rows)]
    if not found:
        return ""
    said = f"small strains are left: {'; '.join(words for _, words in found)}."
    # From a half on, units are suspected.
    if max(size for size, _ in found) < 0.5:
        return f"{said} The linear model, of small strains, turns and slips, does not hold there."
    return f"{said} {_cause(posed, results, int(rows[np.argmax(energies[rows])]))}"


def _strains(space: Space, results: Results, rows: Ints) -> Iterator[Found]:
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
        yield float(size[k]), f"a strain of {size[k]:.2g} {_where(results, mesh.centroids[k], row)}"


def _motions(results: Results, rows: Ints) -> Iterator[Found]:
    """The largest difference of displacements in a body: what all of it moves by strains nothing."""
    mesh = results.mesh
    body = _bodies(mesh)
    order = np.argsort(body, kind="stable")
    begin = np.flatnonzero(np.diff(body[order], prepend=-1))

    def extent(values: Floats) -> Floats:
        """(bodies,) the diagonal of the box around values (n_nodes, dim) of each body."""
        low, high = (of.reduceat(values[order], begin, axis=0) for of in (np.minimum, np.maximum))
        return np.linalg.norm(high - low, axis=1)

    size = extent(mesh.points)
    parts = np.array([extent(results.displacement[row]) for row in rows.tolist()]) / size
    # Differences are the diagonal of their box at most, and its longest edge at least.
    near = np.argwhere(parts >= max(LARGEST_STRAIN, parts.max() / np.sqrt(mesh.points.shape[1])))
    nodes, largest = np.split(order, begin[1:]), (0.0, "")
    for at, one in near.tolist():
        row = int(rows[at])
        u = results.displacement[row][nodes[one]]
        p, q = farthest(u)
        apart = float(np.linalg.norm(u[p] - u[q]))
        if apart > largest[0] * size[one]:
            places = " and ".join(coordinates(mesh.points[nodes[one][k]]) for k in (p, q))
            words = f"displacements that differ by {apart:.3g} in a body of the size {size[one]:.3g}"
            largest = apart / size[one], f"{words}, between {places}, t = {float(results.times[row]):.6g}"
    if largest[0] > LARGEST_STRAIN:
        yield largest


def farthest(points: Floats) -> tuple[int, int]:
    """Two of points (n, dim) that lie farthest apart, to a percent.

    The outermost in 64 directions are a beginning, from which each is moved to the point that is farthest from the
    other, as long as that gains.
    """
    ways = np.random.default_rng(0).normal(size=(64, points.shape[1]))
    along = (points @ way for way in (*ways, *np.eye(points.shape[1])))
    outer = np.unique([[one.argmin(), one.argmax()] for one in along])
    between = np.linalg.norm(points[outer, None] - points[outer], axis=2)
    p, q = (int(outer[k]) for k in np.unravel_index(np.argmax(between), between.shape))
    apart = float(between.max())
    while True:
        from_p = np.linalg.norm(points - points[p], axis=1)
        if not from_p.max() > apart:
            return p, q
        p, q, apart = int(from_p.argmax()), p, float(from_p.max())


def _slips(results: Results, rows: Ints) -> Iterator[Found]:
    """The largest slip between two bodies, in edges of their contact: nodes no longer face those they press on."""
    contact, joined = results.contact, np.flatnonzero(results.contact.partners >= 0)
    if len(joined) == 0:
        return
    edge = contact.lengths[joined] ** (1.0 / (contact.points.shape[1] - 1))
    slip = np.linalg.norm(contact.slip[rows][:, joined], axis=2)
    row, k = np.unravel_index(np.argmax(slip / edge), slip.shape)
    if slip[row, k] > edge[k]:
        size = float(np.linalg.norm(np.ptp(results.mesh.points, axis=0)))
        yield (
            float(slip[row, k]) / size,
            f"a slip of {slip[row, k]:.3g} between bodies whose edges of contact there are {edge[k]:.3g} long "
            f"{_where(results, contact.points[joined[k]], int(rows[row]))}",
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


def _cause(posed: PosedScene, results: Results, row: int) -> str:
    """The likely cause: what does most of the work at a stored instant is in other units than what it acts on."""
    t, u = float(results.times[row]), results.displacement[row].ravel()
    loads, initial = (
        float(sum(load.vector(t) @ u for load in posed.loads if isinstance(load, InitialStresses) is kind))
        for kind in (False, True)
    )
    given = float(results.forces[row].ravel() @ u)
    if loads >= max(initial, given):
        return "Probably young and the loads are in different units, as GPa and MPa: compare them."
    if initial > given:
        return "Probably expansion and temperature, or prestress and young, are in different units: compare them."
    return "Probably what is prescribed (displacements, gaps) and the mesh are in different units: compare them."
