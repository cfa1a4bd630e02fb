"""Corners of the boundary at which stress has no limit: told from angles, materials and conditions.

Near a point where sides meet, displacements behave as r^lam and stresses as r^(lam - 1), with lam the exponent with the
smallest positive real part of the fields that satisfy equilibrium and the conditions of both sides (Williams, *Stress
singularities resulting from various boundary conditions in angular corners of plates in extension*, J. Appl. Mech. 19,
1952). Below 1 a computed stress grows without limit as the mesh is refined, by 2^(1 - lam) where cells are halved. In
a sector of an isotropic body in the plane, kappa = (lambda + 3 mu) / (lambda + mu),

    sigma_tt = lam (lam + 1) F,   sigma_rt = -lam F',   F = A cos (lam+1) t + B sin (lam+1) t + C cos (lam-1) t + ...
    2 mu u_r = -(lam + 1) F + (kappa + 1) (C cos (lam-1) t + D sin (lam-1) t)
    2 mu u_t = -F'          + (kappa + 1) (C sin (lam-1) t - D cos (lam-1) t)

all times powers of r. Two conditions at each end, four where two bodies meet: the exponents are the zeros of the
determinant. Clamps hold both displacements, rollers and contact the one along the normal, loads neither. Contact acts
as it was found at the next node along its side when the extreme was reached: open, sticking, or slipping with the
friction mu p it then had (Comninou, *Stress singularity at a sharp edge in contact problems with friction*, ZAMP 27,
1976).
Friction whose bound is given, and does not follow pressure, is too small near a singular point to hold anything, and
counts as none. Whether the singular field takes part at all depends on the load, and is not asked.

Where what touches, sticks or slips changes along a smooth side, the border lies where stress is bounded, and is no
corner. Materials that meet at the boundary are sectors that stick to each other, at smooth sides, too (Bogy,
*Edge-bonded dissimilar orthogonal elastic wedges under normal and shear loading*, J. Appl. Mech. 35, 1968). Of corners
nothing is said where the material is anisotropic or changes from cell to cell, nor in space.

Under a force on a point stress is as r^-1, and displacement as log r (Flamant 1892, Kelvin 1848); in space as r^-2, and
as r^-1 (Boussinesq 1885).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Annotated

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.effects.effect import Load
from vemcvx.meshes import AnyMesh, PolygonMesh
from vemcvx.meshes.polygons import cell_of_corner
from vemcvx.outline import ArrayRecord
from vemcvx.results.contact import Contact
from vemcvx.results.quoted import ON_CONTACT
from vemcvx.scene.contact_table import ContactRows, pair_numbers
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.supports import free_directions
from vemcvx.vem.boundary import CURVE

Complex = NDArray[np.complex128]
MATERIALS = 8
"""More kinds of cells are no materials, but a field that changes from cell to cell."""
LIMIT = 0.99
"""Exponents from here on are no corner's that matters: at .99 stress grows by .7 % where cells are halved."""


@dataclass(frozen=True)
class Sector:
    """A body between two rays: how far it turns, and its material."""

    angle: float
    kappa: float
    shear: float

    def fields(self, lam: Complex, t: float) -> Complex:
        """(q, 4, 4) u_r, u_t, sigma_tt and sigma_rt / lam on the ray t, by columns of A, B, C and D."""
        plus, minus, none = (lam + 1) * t, (lam - 1) * t, np.zeros_like(lam)
        F = np.array([np.cos(plus), np.sin(plus), np.cos(minus), np.sin(minus)])
        rates = np.array([-(lam + 1), lam + 1, -(lam - 1), lam - 1])
        slope = rates * F[[1, 0, 3, 2]]
        radial = np.array([none, none, F[2], F[3]])
        across = np.array([none, none, F[3], -F[2]])
        u_r = (-(lam + 1) * F + (self.kappa + 1) * radial) / (2 * self.shear)
        u_t = (-slope + (self.kappa + 1) * across) / (2 * self.shear)
        rows: Complex = np.moveaxis(np.array([u_r, u_t, (lam + 1) * F, -slope]), 2, 0)
        return rows


FREE = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
CLAMPED = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]])


def held_along(radial: float, across: float) -> Floats:
    """The conditions of a side that is held along a direction with these components, and carries nothing across it."""
    return np.array([[radial, across, 0.0, 0.0], [0.0, 0.0, radial, -across]])


def slipping(friction: float) -> Floats:
    """The conditions of a side that slides on a rigid obstacle: sigma_rt = friction sigma_tt."""
    return np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -friction, 1.0]])


def joined(state: str, friction: float = 0.0) -> tuple[Floats, Floats]:
    """The conditions (4, 4) on both sides of a joint, which add up to zero: "open", "sticks" or "slips"."""
    one, other = np.zeros((4, 4)), np.zeros((4, 4))
    if state == "open":
        one[:2], other[2:] = FREE, FREE
    elif state == "sticks":
        one, other = np.eye(4), -np.eye(4)
    else:
        one[:3], other[:3] = np.eye(4)[1:], -np.eye(4)[1:]
        one[3] = slipping(friction)[1]
    return one, other


def exponent(
    sectors: Sequence[Sector], joints: Sequence[tuple[Floats, Floats]], ends: tuple[Floats, Floats] | None
) -> float:
    """The smallest real part between 0 and 1 of an exponent, 1 if there is none.

    Parameters
    ----------
    sectors : counter-clockwise
    joints : one between each two; of a full ring, one more, from the last sector to the first
    ends : conditions (2, 4) on the first ray and on the last one; None of a ring
    """
    unit, count = sectors[0].shear, len(sectors)

    def determinant(lam: Complex) -> Complex:
        matrix = np.zeros((len(lam), 4 * count, 4 * count), dtype=complex)
        scale = np.array([unit, unit, 1.0, 1.0])[:, None]
        first = [scale * sector.fields(lam, 0.0) for sector in sectors]
        last = [scale * sector.fields(lam, sector.angle) for sector in sectors]
        row = 0
        for k, (one, other) in enumerate(joints):
            after = (k + 1) % count
            matrix[:, row : row + 4, 4 * k : 4 * k + 4] += one @ last[k]
            matrix[:, row : row + 4, 4 * after : 4 * after + 4] += other @ first[after]
            row += 4
        if ends is not None:
            matrix[:, row : row + 2, :4] = ends[0] @ first[0]
            matrix[:, row + 2 :, -4:] = ends[1] @ last[-1]
        found: Complex = np.linalg.det(matrix)
        return found

    real, imaginary = np.meshgrid(np.linspace(0.06, 0.98, 13), [0.0, 0.1, 0.4])
    lam = (real + 1j * imaginary).ravel()
    with np.errstate(all="ignore"):
        # Double zeros, as of a crack, are approached by halves.
        for _ in range(30):
            value, h = determinant(lam), 1e-6
            step = value * 2 * h / (determinant(lam + h) - determinant(lam - h))
            lam = np.where(np.isfinite(step) & (np.abs(step) < 1.0), lam - step, lam)
        settled = np.isfinite(step) & (np.abs(step) < 1e-6)
    inside = settled & (lam.real > 0.02) & (lam.real < LIMIT) & (np.abs(lam.imag) < 2.0)
    return float(lam.real[inside].min(initial=1.0))


@dataclass(frozen=True, kw_only=True, repr=False)
class Sides(ArrayRecord):
    """The conditions on the edges of the boundary, of which bodies in space have none, and point loads.

    Attributes
    ----------
    edges : (b, 2) int
        Each with the body on its left.
    free : (b, 4)
        Projectors (2, 2) on the directions that supports leave free, row by row.
    contact : (b,) bool
        True where the edge touches, or may touch, something rigid, or is the first body's at an interface.
    pressed : (b,) bool
        True where friction follows pressure.
    loaded : (q,) int or None
        The nodes on which forces act as on points.
    """

    edges: Annotated[Ints, "sides 2", ""]
    free: Annotated[Floats, "sides 4", ""]
    contact: Annotated[Bools, "sides", ""]
    pressed: Annotated[Bools, "sides", ""]
    loaded: Annotated[Ints | None, "loaded", ""] = None

    @cached_property
    def leaving(self) -> dict[int, int]:
        """The edge that begins at a node; -1 where there are several."""
        return _once(self.edges[:, 0])

    @cached_property
    def arriving(self) -> dict[int, int]:
        """The edge that ends at a node, likewise."""
        return _once(self.edges[:, 1])


def _once(nodes: Ints) -> dict[int, int]:
    found: dict[int, int] = {}
    for k, node in enumerate(nodes.tolist()):
        found[node] = -1 if node in found else k
    return found


def sides_of(posed: PosedScene) -> Sides:
    """The sides of a posed scene."""
    mesh = posed.space.mesh
    loads = [load for load in posed.loads if isinstance(load, Load) and load.cells is None and load.edges is None]
    rows = np.concatenate([np.zeros(0, np.int64), *(load.matrix.tocoo().row for load in loads)])
    loaded = np.unique(rows // mesh.points.shape[1])
    if not isinstance(mesh, PolygonMesh):
        none = np.zeros(0, dtype=bool)
        return Sides(
            edges=np.zeros((0, 2), dtype=np.int64), free=np.zeros((0, 4)), contact=none, pressed=none, loaded=loaded
        )
    edges, terms = mesh.boundaries["boundary"], posed.terms
    laws = [friction.law is not None and friction.law.pressed for friction in terms.frictions]
    follows = np.repeat(np.array(laws, dtype=float), [len(friction.nodes) for friction in terms.frictions])
    pressed, soft = np.flatnonzero(terms.gather @ follows > 0), posed.obstacles.compliance > 0
    return Sides(
        edges=edges,
        free=free_directions(posed.supports.P, edges.ravel(), np.repeat(np.arange(len(edges)), 2), 2).reshape(-1, 4),
        # What gives way presses with a force that has a limit, as a load.
        contact=_owned(posed.surface, edges) & ~_owned(posed.obstacles[np.flatnonzero(soft)], edges),
        pressed=_owned(terms[pressed], edges),
        loaded=loaded,
    )


def _owned(rows: ContactRows, edges: Ints) -> Bools:
    """Whether some row owns an end of each edge."""
    names, most = rows.names[np.unique(sp.csr_matrix(rows.ends).indices)], int(edges.max())
    known, one, other = (pair_numbers(pairs[:, 0], pairs[:, 1], most) for pairs in (names, edges, edges[:, ::-1]))
    return np.isin(one, known) | np.isin(other, known)


@dataclass(frozen=True)
class Corner:
    """A point of the boundary at an instant: the exponent there, in words where it is, and what touches."""

    exponent: float
    where: str
    touches: bool
    rubs: bool
    """whether friction that follows pressure acts there"""


NOWHERE = Corner(1.0, "", False, False)


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of a body with the contact and moduli of a run, each judged once; none where sides are not known."""

    mesh: AnyMesh
    contact: Contact
    moduli: Floats
    sides: Sides | None
    known: dict[tuple[int, int], Corner] = field(default_factory=dict)

    @cached_property
    def varies(self) -> bool:
        """True if moduli change from cell to cell, and not from material to material."""
        return len(np.unique(self.moduli, axis=1).T) > MATERIALS

    @cached_property
    def across(self) -> dict[tuple[int, int], tuple[int, int]]:
        """The edge of another body in the place of each edge of an interface."""
        found: dict[tuple[int, int], tuple[int, int]] = {}
        for interface in self.mesh.interfaces.values():
            for (a, b), (c, d) in zip(interface.edges.tolist(), interface.partners.tolist(), strict=True):
                found |= {(a, b): (d, c), (d, c): (a, b)}
        return found

    def beside(self, node: int) -> list[int]:
        """A node of the boundary and those next to it: a corner that supports hold is no node of contact itself."""
        sides = self.sides
        if sides is None:
            return []
        near = [sides.edges[table[node]] for table in (sides.leaving, sides.arriving) if table.get(node, -1) >= 0]
        return [node, *(other for edge in near for other in edge.tolist() if other != node)]

    def sentence(self, near: Mapping[int, float], row: int, key: str) -> str:
        """The sentence on an extreme reached near these nodes, at a row of the arrays; empty if there is none.

        `key` is that of the extreme, and nodes have the largest value of the cells at them, as a part of it.
        Displacement and slip are bounded at all corners; friction whose bound is given is, too.
        """
        sides = self.sides
        if sides is None:
            return ""
        nodes = [node for node, part in near.items() if part == 1.0]
        bounded = key == "slip" or (key == "friction" and not self.rubs(sides, nodes))
        if not bounded and sides.loaded is not None and np.isin(nodes, sides.loaded).any():
            order = self.mesh.points.shape[1] - (2 if key == "displacement" else 1)
            like = f"r^-{order}" if order else "log r"
            return f"at a point load: grows without limit as the mesh is refined, like {like}"
        if key in ("displacement", "slip"):
            return ""
        found = []
        for node, part in near.items():
            if (node, row) not in self.known:
                self.known[node, row] = self.judged(sides, node, row)
            # A cell at a corner that has 2^(lam - 1) of an extreme beside it exceeds this once cells are halved.
            if part >= 2.0 ** (self.known[node, row].exponent - 1.0):
                found.append(self.known[node, row])
        if key in ON_CONTACT:
            found = [one for one in found if one.touches and (one.rubs or key != "friction")]
        worst = min(found, key=lambda one: one.exponent, default=NOWHERE)
        if worst.exponent >= LIMIT:
            return ""
        return f"{worst.where}: grows without limit as the mesh is refined, like r^{worst.exponent - 1:.2f}"

    @staticmethod
    def rubs(sides: Sides, nodes: Sequence[int]) -> bool:
        """Whether friction that follows pressure acts at one of the nodes, in the plane."""
        return bool(sides.pressed[np.isin(sides.edges, nodes).any(axis=1)].any())

    def judged(self, sides: Sides, node: int, row: int) -> Corner:
        """The corner at a node, at a row of the arrays."""
        chain = self.around(sides, node)
        if chain is None:
            return NOWHERE
        nodes, ring = chain
        made = [_sectors(self, sides, node) for node in nodes]
        if not all(made):
            return NOWHERE
        sectors, mixed = [sector for several in made for sector in several], len(made) < sum(map(len, made))
        first, last = sides.leaving[nodes[0]], sides.arriving[nodes[-1]]
        joints = [_joint(self, sides, sides.arriving[node], row) for node in (nodes if ring else nodes[:-1])]
        names, rows, ends = [name for name, _ in joints], list[tuple[Floats, Floats]](), None
        for k, several in enumerate(made):
            rows += [joined("sticks")] * (len(several) - 1) + [rows_of for _, rows_of in joints[k : k + 1]]
        angles = np.array([sum(sector.angle for sector in several) for several in made])
        if ring:
            smooth = len(nodes) > 1
        else:
            start, end = (_condition(self, sides, k, row, leaving) for k, leaving in ((first, True), (last, False)))
            names, ends = [start[0], *names, end[0]], (start[1], end[1])
            # A roller is a plane of symmetry, behind which the body goes on as its mirror image.
            mirrored = "roller" in (start[0], end[0])
            angles = angles * (2.0 if mirrored else 1.0)
            smooth = mirrored or start[0] == end[0] or bool(sides.contact[first] and sides.contact[last])
        if smooth and not mixed and (np.abs(angles - np.pi) < CURVE).all():
            return NOWHERE
        kinds = list(dict.fromkeys(sorted(names)))
        where = "at a reentrant corner" if kinds == ["free side"] else f"at a corner of {' and '.join(kinds)}"
        where = f"where materials meet at {' and '.join(kinds)}" if mixed else where
        touching = [k for node in nodes for k in (sides.leaving[node], sides.arriving[node]) if sides.contact[k]]
        return Corner(exponent(sectors, rows, ends), where, bool(touching), bool(sides.pressed[touching].any()))

    def around(self, sides: Sides, node: int) -> tuple[list[int], bool] | None:
        """The nodes of all bodies that meet at a node, counter-clockwise, and whether they close a ring."""

        def beyond(node: int, arriving: bool) -> int | None:
            edge = tuple(sides.edges[(sides.arriving if arriving else sides.leaving)[node]].tolist())
            other = self.across.get((edge[0], edge[1]))
            return None if other is None else other[0 if arriving else 1]

        def known(node: int) -> bool:
            return sides.leaving.get(node, -1) >= 0 and sides.arriving.get(node, -1) >= 0

        nodes = [node]
        for arriving in (True, False):
            while known(nodes[-1 if arriving else 0]):
                after = beyond(nodes[-1 if arriving else 0], arriving)
                if after is None:
                    break
                if after in nodes:
                    return (nodes, True) if arriving and after == nodes[0] else None
                nodes = [*nodes, after] if arriving else [after, *nodes]
        return (nodes, False) if all(map(known, nodes)) else None


def _sectors(corners: Corners, sides: Sides, node: int) -> list[Sector]:
    """The body at a node counter-clockwise, a sector for each material; none where moduli vary, or are not two."""
    mesh = corners.mesh
    assert isinstance(mesh, PolygonMesh)
    if len(corners.moduli) != 2 or corners.varies:
        return []
    at = np.flatnonzero(mesh.vertices == node)
    cells = cell_of_corner(mesh.offsets)[at]
    first, size = mesh.offsets[cells], np.diff(mesh.offsets)[cells]
    after = mesh.points[mesh.vertices[first + (at - first + 1) % size]] - mesh.points[node]
    out = mesh.points[sides.edges[sides.leaving[node], 1]] - mesh.points[node]
    back = mesh.points[sides.edges[sides.arriving[node], 0]] - mesh.points[node]
    # A ray that is out itself may be turned from it by rounding, backwards.
    order = np.argsort((_turned(out, after) + 1e-6) % (2 * np.pi))
    rays, cells = [*after[order], back], cells[order]
    moduli, found = corners.moduli[:, cells], list[Sector]()
    begins = np.flatnonzero(np.append(True, (np.abs(np.diff(moduli)) > 1e-9 * moduli.max(axis=1)[:, None]).any(axis=0)))
    for begin, end in pairwise([*begins.tolist(), len(cells)]):
        angle, (lame, shear) = float(_turned(rays[begin], rays[end])), moduli[:, begin]
        # The two sides of a crack are one ray.
        found.append(
            Sector(angle if angle > 1e-6 else 2 * np.pi, float((lame + 3 * shear) / (lame + shear)), float(shear))
        )
    return found


def _turned(one: Floats, other: Floats) -> Floats:
    """The angles from one direction to others (..., 2), counter-clockwise, from 0 to 2 pi."""
    turned: Floats = np.arctan2(one[0] * other[..., 1] - one[1] * other[..., 0], other @ one) % (2 * np.pi)
    return turned


def _condition(corners: Corners, sides: Sides, k: int, row: int, leaving: bool) -> tuple[str, Floats]:
    """The condition on an edge at an end of the chain: `leaving` edges are the first ray, others the last."""
    a, b = corners.mesh.points[sides.edges[k]]
    along = (b - a if leaving else a - b) / np.linalg.norm(b - a)
    across = np.array([-along[1], along[0]])
    free = sides.free[k].reshape(2, 2)
    freedom = float(np.trace(free))
    if freedom < 0.5:
        return "clamp", CLAMPED
    if sides.contact[k]:
        state, friction = _state(corners, sides, k, int(sides.edges[k, 1 if leaving else 0]), row)
        name = _contact(sides, k, state)
        if state == "open":
            return name, FREE
        # The outward normal is along t on the last ray, and against it on the first.
        return name, CLAMPED if state == "sticks" else slipping(friction if leaving else -friction)
    if freedom < 1.5:
        held = np.eye(2) - free
        direction = held[:, int(np.argmax(np.diag(held)))]
        direction = direction / np.linalg.norm(direction)
        return "roller", held_along(float(direction @ along), float(direction @ across))
    return "free side", FREE


def _joint(corners: Corners, sides: Sides, k: int, row: int) -> tuple[str, tuple[Floats, Floats]]:
    """The condition on an edge where two bodies meet, the last ray of the first of them."""
    if not sides.contact[k]:
        other = corners.across[(int(sides.edges[k, 0]), int(sides.edges[k, 1]))]
        k = sides.leaving[other[0]]
        if not sides.contact[k]:
            return "open joint", joined("open")
        state, friction = _state(corners, sides, k, int(sides.edges[k, 1]), row)
    else:
        state, friction = _state(corners, sides, k, int(sides.edges[k, 0]), row)
        friction = -friction
    return _contact(sides, k, state), joined(state, friction)


def _contact(sides: Sides, k: int, state: str) -> str:
    """The words for contact on an edge in this state."""
    return "open contact" if state == "open" else f"contact that {state}" if sides.pressed[k] else "contact"


def _state(corners: Corners, sides: Sides, k: int, node: int, row: int) -> tuple[str, float]:
    """What contact does at a node of an edge, and friction outwards from the corner over pressure, if it follows it."""
    contact = corners.contact
    at = np.flatnonzero(contact.nodes == node)
    if len(at) == 0 or not contact.closed[row, at[0]]:
        return "open", 0.0
    i = int(at[0])
    if not sides.pressed[k]:
        return "slips", 0.0
    if contact.sticking[row, i]:
        return "sticks", 0.0
    corner = int(sides.edges[k, 0] if sides.edges[k, 1] == node else sides.edges[k, 1])
    along = corners.mesh.points[node] - corners.mesh.points[corner]
    pressure = float(contact.pressure[row, i])
    if pressure <= 0.0:
        return "slips", 0.0
    return "slips", float(contact.traction[row, i] @ along) / float(np.linalg.norm(along)) / pressure
