"""Corners of the boundary at which stress has no limit: told from angles, materials, conditions and loads.

Exponents, and the logarithms of given shear, are those of :mod:`vemcvx.results.wedges`. Clamps hold both
displacements, rollers and contact the one along the normal, loads neither. Contact acts as it was found at the next
node along its side when the extreme was reached: open, sticking, or slipping with the friction mu p it then had
(Comninou, *Stress singularity at a sharp edge in contact problems with friction*, ZAMP 27, 1976). Friction whose bound
is given does not follow pressure. On a mesh on which it holds the corner and the node next to it, it is a clamp, and
stress grows until it holds them no more; where it slips, it is a shear traction that is known.

Whether the singular field takes part at all depends on the load, and is not asked. But of principal stresses, and of
pressure, it is asked with which sign it does: often both principal stresses of the field have one sign at all angles,
and one extreme grows and the other does not. Its factor is that of least squares, over the cells at the corner by area,

    sum a_K stress_K : f(x_K) / sum a_K f(x_K) : f(x_K),   f the stress of the field.

Shear tractions, given or of friction that slips at its bound, make stress grow like log r where they do not match:
where they jump along a straight side, and where contact or a roller meets a side at a right angle on which there is
another shear. Friction that changes its sign along a side, or slips up to a plane of symmetry, does so at a node of
the mesh, but sticks in between on the continuum, and nothing is said of it, unless the corner itself is moved over what
it rubs on.

Where what touches, sticks or slips changes along a smooth side, the border lies where stress is bounded, and is no
corner. Materials that meet at the boundary are sectors that stick to each other, at smooth sides, too (Bogy,
*Edge-bonded dissimilar orthogonal elastic wedges under normal and shear loading*, J. Appl. Mech. 35, 1968). Corners
are not judged where the material is anisotropic or changes from cell to cell, nor are edges and corners in space, nor
the logarithms that springs and initial stresses make where they end.

Under a force on a point stress is as r^-1, and displacement as log r (Flamant 1892, Kelvin 1848); in space as r^-2, and
as r^-1 (Boussinesq 1885).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from vemcvx.base.arrays import Bools, Floats, Ints
from vemcvx.meshes import AnyMesh, PolygonMesh
from vemcvx.meshes.polygons import cell_of_corner
from vemcvx.results.contact import Contact, Sides
from vemcvx.results.quoted import ON_CONTACT
from vemcvx.results.wedges import CLAMPED, FREE, LIMIT, Sector, Wedge, held_along, joined, slipping, turned
from vemcvx.vem.boundary import CURVE
from vemcvx.vem.elasticity import principal

GROWS = "grows without limit as the mesh is refined"


@dataclass(frozen=True, eq=False)
class Corner:
    """A point of the boundary at an instant, and what meets there."""

    wedge: Wedge
    where: str  # in words
    nodes: tuple[int, ...]  # those of all bodies there
    start: float  # the angle of the first ray to the x axis
    rays: Floats = field(default_factory=lambda: np.zeros(0))  # angles from there at which there is contact
    rubs: bool = False  # whether friction that follows pressure acts there
    holds: bool = False  # whether friction with a given bound sticks there
    singular: bool = True  # not along smooth sides
    jumps: bool = False  # whether displacements that are given jump there
    shear: Floats | None = None  # the stress that log r multiplies, as A, B, C and D of each sector; None without any

    @property
    def exponent(self) -> float:
        """The exponent of the field whose stress grows most; 1 where there is none."""
        if self.jumps:
            return 0.0
        return self.wedge.exponent if self.singular else 1.0

    def reach(self, lam: float, x: Floats, key: str) -> float:
        """The largest of what an extreme is of, at r = 1, of the field with this exponent."""
        if key in PRESSURES:
            across = turned(self.wedge.stress(lam, x, self.rays), -self.rays)[:, 1]
            return float(np.max(-across, initial=0.0))
        t = np.linspace(0.0, self.wedge.angle, 181)
        return float(_sizes(self.wedge.stress(lam, x, t), key).max())

    def field(self, mesh: AnyMesh, x: Floats, cells: Ints) -> Floats:
        """(q, 3) the stress of the field with the leading exponent at the centroids of cells."""
        out = mesh.centroids[cells] - mesh.points[self.nodes[0]]
        t = np.clip((np.arctan2(out[:, 1], out[:, 0]) - self.start) % (2 * np.pi), 0.0, self.wedge.angle)
        field = turned(self.wedge.stress(self.exponent, x, t), self.start)
        field *= np.linalg.norm(out, axis=1)[:, None] ** (self.exponent - 1.0)
        return field

    def factor(self, mesh: AnyMesh, x: Floats, stress: Floats) -> float:
        """By which a field takes part in the stress (n_cells, 3), as the cells at the corner have it."""
        assert isinstance(mesh, PolygonMesh)
        cells = np.unique(cell_of_corner(mesh.offsets)[np.isin(mesh.vertices, self.nodes)])
        field, weights = self.field(mesh, x, cells), np.array([1.0, 1.0, 2.0])
        both, square = ((mesh.areas[cells] @ (field * other)) @ weights for other in (stress[cells], field))
        return float(both / square)

    def powers(self, mesh: AnyMesh, key: str, peak: Peak, part: float) -> bool:
        """Return True if an extreme grows as the exponent says, a cell at the corner having a part of it."""
        if key in ON_CONTACT and (len(self.rays) == 0 or (key == "friction" and not (self.rubs or self.holds))):
            return False
        # A cell at a corner that has 2^(lam - 1) of an extreme beside it exceeds this once cells are halved.
        if self.jumps or part < 2.0 ** (self.exponent - 1.0):
            return self.jumps
        if key not in SIGNED or peak.stress is None or (x := self.wedge.mode) is None:
            return True
        x = self.factor(mesh, x, peak.stress) * x
        return self.reach(self.exponent, x, key) >= PART * self.reach(self.exponent, x, "von_mises")

    def adds(self, key: str) -> float:
        """The growth of an extreme by the logarithm where cells are halved."""
        return 0.0 if key == "friction" or self.shear is None else self.reach(1.0, -np.log(2.0) * self.shear, key)


class Peak(NamedTuple):
    """An extreme value, and the stress (n_cells, 3) at its instant where its sign matters."""

    value: float = np.inf
    stress: Floats | None = None


NO_PEAK = Peak()


def _sizes(stress: Floats, key: str) -> Floats:
    """The quantity (q,) of stress (q, 3) that an extreme is the largest of."""
    both = principal(stress)
    if key == "largest_principal_stress":
        return both[:, 0]
    return -both[:, 1] if key == "smallest_principal_stress" else np.maximum(both[:, 0], -both[:, 1])


PRESSURES = "pressure", "pressure_recovered"
SIGNED = "largest_principal_stress", "smallest_principal_stress", *PRESSURES
"""Keys of extremes that grow, or do not, with the sign of the field."""
PART = 0.05  # A principal stress that is less than this part of the field's largest is none of the field's.


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of a body with the contact and moduli of a run, each judged once; none where sides are not known."""

    mesh: AnyMesh
    contact: Contact
    moduli: Floats
    sides: Sides | None
    known: dict[tuple[int, int], Corner | None] = field(default_factory=dict)

    @cached_property
    def varies(self) -> bool:
        """True if moduli change from cell to cell: more than eight kinds are no materials."""
        return len(np.unique(self.moduli, axis=1).T) > 8

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

    def sentence(self, near: Mapping[int, float], row: int, key: str, peak: Peak = NO_PEAK) -> str:
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
            return f"at a point load: {GROWS}, like {f'r^-{order}' if order else 'log r'}"
        if key in ("displacement", "slip"):
            return ""
        met = [(self.known_at(sides, node, row), part) for node, part in near.items()]
        corners = [(corner, part) for corner, part in met if corner is not None]
        singular = [(one, part) for one, part in corners if one.exponent < LIMIT]
        powers = [one for one, part in singular if one.powers(self.mesh, key, peak, part)]
        if powers:
            worst = min(powers, key=lambda one: one.exponent)
            grows = "grows as the mesh is refined, as long as friction holds" if worst.holds else GROWS
            power = "-1" if worst.jumps else f"{worst.exponent - 1:.2f}"
            return f"{worst.where}: {grows}, like r^{power}"
        least, size = 2.0 ** (1.0 - LIMIT) - 1.0, abs(peak.value)
        adding = [one for one, part in corners if one.adds(key) >= max(size * max(1.0 - part, least), np.spacing(0.0))]
        return f"{adding[0].where}: {GROWS}, like log r" if adding else ""

    def known_at(self, sides: Sides, node: int, row: int) -> Corner | None:
        """The corner at a node, at a row of the arrays, judged once."""
        if (node, row) not in self.known:
            self.known[node, row] = self.judged(sides, node, row)
        return self.known[node, row]

    @staticmethod
    def rubs(sides: Sides, nodes: Sequence[int]) -> bool:
        """Return True if friction that follows pressure acts at one of the nodes, in the plane."""
        return bool(sides.pressed[np.isin(sides.edges, nodes).any(axis=1)].any())

    def judged(self, sides: Sides, node: int, row: int) -> Corner | None:
        """The corner at a node, at a row of the arrays; None where nothing is to be said."""
        if node not in sides.leaving and node not in sides.arriving:
            return self.inside(node) if len(sides.edges) else None
        chain = self.around(sides, node)
        if chain is None:
            return None
        nodes, ring = chain
        made = [_sectors(self, sides, node) for node in nodes]
        if not all(made):
            return None
        joints = [_joint(self, sides, sides.arriving[node], row) for node in (nodes if ring else nodes[:-1])]
        ends = [] if ring else [_condition(self, sides, sides.leaving[nodes[0]], row, True)]
        ends += [] if ring else [_condition(self, sides, sides.arriving[nodes[-1]], row, False)]
        smooth, jumps = _smooth(made, ends, ring), not ring and _jumps(sides, nodes, row, ends)
        if smooth and not jumps and not (ends and _straight(made, ends)):
            return None
        out = self.mesh.points[sides.edges[sides.leaving[nodes[0]], 1]] - self.mesh.points[nodes[0]]
        touching = [k for node in nodes for k in (sides.leaving[node], sides.arriving[node]) if sides.contact[k]]
        turns = np.cumsum([0.0, *(sum(sector.angle for sector in several) for several in made)])
        between = zip([*ends[:1], *joints, *ends[1:]], turns if ends else turns[1:], strict=True)
        wedge = _wedge(made, joints, ends)
        return Corner(
            wedge=wedge,
            where=JUMP if jumps else _where([*ends, *joints], smooth, mixed=max(map(len, made)) > 1),
            nodes=tuple(nodes),
            start=float(np.arctan2(out[1], out[0])),
            rays=np.array([turn for one, turn in between if "contact" in one.name]),
            rubs=bool(sides.pressed[touching].any()),
            holds=any(one.state.holds for one in (*ends, *joints)),
            singular=not smooth,
            jumps=jumps,
            shear=wedge.logarithm(_given(made, joints, ends)) if smooth or _asked(ends) else None,
        )

    def inside(self, node: int) -> Corner | None:
        """The point at which materials meet inside a body, that is no point of a smooth interface."""
        made, start = _ring(self, node)
        if len(made) < 2 or (len(made) == 2 and abs(made[0].angle - np.pi) < CURVE):
            return None
        wedge = Wedge(made, [joined("sticks")] * len(made), None)
        return Corner(wedge, "where materials meet inside the body", (node,), start)

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
    points = corners.mesh.points
    if len(corners.moduli) != 2 or corners.varies:
        return []
    rays, cells = _fan(corners.mesh, node)
    out = points[sides.edges[sides.leaving[node], 1]] - points[node]
    back = points[sides.edges[sides.arriving[node], 0]] - points[node]
    # A ray that is out itself may be turned from it by rounding, backwards.
    order = np.argsort((_turned(out, rays) + 1e-6) % (2 * np.pi))
    return _materials([*rays[order], back], corners.moduli[:, cells[order]])


def _ring(corners: Corners, node: int) -> tuple[list[Sector], float]:
    """The materials around a node inside of a body, and the angle to the x axis at which the first begins."""
    if len(corners.moduli) != 2 or corners.varies:
        return [], 0.0
    rays, cells = _fan(corners.mesh, node)
    angles = np.arctan2(rays[:, 1], rays[:, 0])
    order = np.argsort(angles)
    begins = np.flatnonzero(_differ(corners.moduli[:, cells[np.roll(order, 1)]], corners.moduli[:, cells[order]]))
    if len(begins) == 0:
        return [], 0.0
    order = np.roll(order, -begins[0])
    return _materials([*rays[order], rays[order[0]]], corners.moduli[:, cells[order]]), float(angles[order[0]])


def _fan(mesh: AnyMesh, node: int) -> tuple[Floats, Ints]:
    """The cells at a node, and of each the ray (2,) along which it begins, counter-clockwise."""
    assert isinstance(mesh, PolygonMesh)
    at = np.flatnonzero(mesh.vertices == node)
    cells = cell_of_corner(mesh.offsets)[at]
    first, size = mesh.offsets[cells], np.diff(mesh.offsets)[cells]
    return mesh.points[mesh.vertices[first + (at - first + 1) % size]] - mesh.points[node], cells


def _differ(one: Floats, other: Floats) -> Bools:
    """Return True where the moduli (2, q) of materials differ, (q,)."""
    largest = np.abs(one).max(axis=1, initial=0.0)[:, None]
    return (np.abs(one - other) > 1e-9 * largest).any(axis=0)


def _materials(rays: Sequence[Floats], moduli: Floats) -> list[Sector]:
    """Sectors of one material each, from the moduli (2, q) between q + 1 rays."""
    begins = np.flatnonzero(np.append(True, _differ(moduli[:, 1:], moduli[:, :-1])))
    found: list[Sector] = []
    for begin, end in pairwise([*begins.tolist(), moduli.shape[1]]):
        angle, (lame, shear) = float(_turned(rays[begin], rays[end])), moduli[:, begin]
        whole = angle if angle > 1e-6 else 2 * np.pi  # The two sides of a crack are one ray.
        found.append(Sector(whole, float((lame + 3 * shear) / (lame + shear)), float(shear)))
    return found


def _turned(one: Floats, other: Floats) -> Floats:
    """The angles from one direction to others (..., 2), counter-clockwise, from 0 to 2 pi."""
    return np.arctan2(one[0] * other[..., 1] - one[1] * other[..., 0], other @ one) % (2 * np.pi)


class State(NamedTuple):
    """The state of contact on an edge: friction outwards from the corner over pressure, or as it is given."""

    name: str = "none"
    friction: float = 0.0
    shear: float = 0.0
    holds: bool = False  # whether friction with a given bound sticks
    moves: bool = True  # whether the node of contact at the corner itself, if there is one, slips

    @property
    def slips(self) -> bool:
        """True if contact slips with friction that is known."""
        return self.name == "slips" and self.friction == 0.0


NO_STATE = State()


@dataclass(frozen=True, eq=False)
class Condition:
    """The condition on a ray: in words, as rows (of a joint those of both sides), and the tractions that these meet."""

    name: str
    rows: Floats
    given: Floats
    state: State = NO_STATE


JUMP = "where displacements that are given jump"


def _jumps(sides: Sides, nodes: list[int], row: int, ends: list[Condition]) -> bool:
    """Return True if displacements given on both sides of a node differ: a hundredth of the largest is no rounding."""
    if sides.moved is None or len(nodes) > 1 or any(end.name != "clamp" for end in ends):
        return False
    moved, (node,) = sides.moved[row], nodes
    apart = moved[sides.leaving[node], :2] - moved[sides.arriving[node], 2:]
    return bool(np.linalg.norm(apart) > 0.01 * np.abs(moved).max())


def _smooth(made: list[list[Sector]], ends: list[Condition], ring: bool) -> bool:
    """Return True if a side goes on smoothly: whether it touches, sticks or slips there may change."""
    names = [end.name for end in ends]
    # A roller is a plane of symmetry, behind which the body goes on as its mirror image.
    mirrored = "roller" in names
    angles = (2.0 if mirrored else 1.0) * np.array([sum(sector.angle for sector in several) for several in made])
    alike = len(made) > 1 if ring else mirrored or names[0] == names[1] or all("contact" in name for name in names)
    return alike and max(map(len, made)) == 1 and bool((np.abs(angles - np.pi) < CURVE).all())


def _straight(made: list[list[Sector]], ends: list[Condition]) -> bool:
    """Return True if a body's side goes on straight, loaded or slipping the same way: a jump of shear tells there."""
    names = {end.name for end in ends}
    angle = made[0][0].angle * (2.0 if "roller" in names else 1.0)
    if len(made) > 1 or abs(angle - np.pi) > 1e-6:
        return False
    # sigma_rt of the two rays, along opposite directions.
    one_way = ends[0].given[1] * ends[1].given[1] >= 0.0
    slips = one_way and all(end.state.slips for end in ends)
    return names <= {"free side", "roller"} or slips or ("roller" in names and all(end.state.moves for end in ends))


def _wedge(made: list[list[Sector]], joints: list[Condition], ends: list[Condition]) -> Wedge:
    """The sectors of all bodies, those of one body glued to each other."""
    rows: list[tuple[Floats, Floats]] = []
    for k, several in enumerate(made):
        rows += [joined("sticks")] * (len(several) - 1) + [(one.rows[0], one.rows[1]) for one in joints[k : k + 1]]
    sectors = [sector for several in made for sector in several]
    return Wedge(sectors, rows, (ends[0].rows, ends[1].rows) if ends else None)


def _given(made: list[list[Sector]], joints: list[Condition], ends: list[Condition]) -> Floats:
    """The tractions that the rows of a wedge meet."""
    given = [np.zeros(4 * len(several)) for several in made]
    for own, joint in zip(given, joints, strict=False):
        own[-4:] = joint.given
    return np.concatenate([np.concatenate(given)[: -4 if ends else None], *(end.given for end in ends)])


def _asked(ends: list[Condition]) -> bool:
    """False beside what holds a corner in its place: friction that slips on the mesh may stick on the continuum."""
    return len(ends) > 0 and (any(end.name == "free side" for end in ends) or all(end.state.moves for end in ends))


def _where(met: list[Condition], smooth: bool, mixed: bool) -> str:
    kinds = list(dict.fromkeys(sorted(one.name for one in met)))
    if smooth and len(kinds) == 1:
        return f"where shear jumps along a {kinds[0]}".replace("a contact", "contact")
    if mixed:
        return f"where materials meet at {' and '.join(kinds)}"
    return "at a reentrant corner" if kinds == ["free side"] else f"at a corner of {' and '.join(kinds)}"


def _condition(corners: Corners, sides: Sides, k: int, row: int, leaving: bool) -> Condition:
    """The condition on an edge at an end of the chain: `leaving` edges are the first ray, others the last."""
    a, b = corners.mesh.points[sides.edges[k]]
    along = (b - a if leaving else a - b) / np.linalg.norm(b - a)
    frame = np.array([[-along[1], along[0]], along])
    # The outward normal is along t on the last ray, and against it on the first.
    sign = -1.0 if leaving else 1.0
    load = np.zeros(2) if sides.traction is None else sides.traction[row, k, slice(0, 2) if leaving else slice(2, 4)]
    given, free = sign * frame @ load, sides.free[k].reshape(2, 2)
    freedom = float(np.trace(free))
    if freedom < 0.5:
        return Condition("clamp", CLAMPED, np.zeros(2))
    if sides.contact[k]:
        state = _state(corners, sides, k, int(sides.edges[k, 1 if leaving else 0]), row)
        rows = {"open": FREE, "sticks": CLAMPED}.get(state.name, slipping(-sign * state.friction))
        return Condition(_contact(sides, k, state), rows, rows[:, 2:] @ given + [0.0, sign * state.shear], state)
    if freedom < 1.5:
        held = np.eye(2) - free
        direction = held[:, int(np.argmax(np.diag(held)))]
        across, radial = frame @ direction / np.linalg.norm(direction)
        rows = held_along(float(radial), float(across))
        return Condition("roller", rows, rows[:, 2:] @ given)
    return Condition("free side", FREE, given)


def _joint(corners: Corners, sides: Sides, k: int, row: int) -> Condition:
    """The condition on an edge where two bodies meet, the last ray of the first of them."""
    sign, end = 1.0, 0
    if not sides.contact[k]:
        other = corners.across[(int(sides.edges[k, 0]), int(sides.edges[k, 1]))]
        k, sign, end = sides.leaving[other[0]], -1.0, 1
        if not sides.contact[k]:
            return Condition("open joint", np.array(joined("open")), np.zeros(4))
    state = _state(corners, sides, k, int(sides.edges[k, end]), row)
    rows = np.array(joined(state.name, -sign * state.friction))
    return Condition(_contact(sides, k, state), rows, np.array([0.0, 0.0, 0.0, sign * state.shear]), state)


def _contact(sides: Sides, k: int, state: State) -> str:
    """The words for contact on an edge in this state."""
    if state.name == "open":
        return "open contact"
    return f"contact that {state.name}" if sides.pressed[k] or state.holds else "contact"


def _state(corners: Corners, sides: Sides, k: int, node: int, row: int) -> State:
    """The state of contact at a node of an edge."""
    contact = corners.contact
    at = np.flatnonzero(contact.nodes == node)
    if len(at) == 0 or not contact.closed[row, at[0]]:
        return State("open")
    i = int(at[0])
    corner = int(sides.edges[k, 0] if sides.edges[k, 1] == node else sides.edges[k, 1])
    along = corners.mesh.points[node] - corners.mesh.points[corner]
    along = along / np.linalg.norm(along)
    if not sides.pressed[k]:
        nodes = [i, *np.flatnonzero(contact.nodes == corner)[:1].tolist()]
        below = _below(contact, row)
        if below[nodes].all():
            return State("sticks", holds=True)
        moves = len(nodes) > 1 and not contact.sticking[row, nodes[1]]
        return State("slips", shear=_shear(contact, nodes, below, contact.traction[row] @ along, along), moves=moves)
    if contact.sticking[row, i]:
        return State("sticks")
    pressure = float(contact.pressure[row, i])
    if pressure <= 0.0:
        return State("slips")
    return State("slips", float(contact.traction[row, i] @ along) / pressure)


def _below(contact: Contact, row: int) -> Bools:
    """Return True where friction is below its given bound, (m,): a node that rests there may have slipped before."""
    below: Bools = np.linalg.norm(contact.traction[row], axis=1) < (1.0 - 1e-6) * contact.bound[row]
    below &= contact.sticking[row] & contact.closed[row]
    return below


def _shear(contact: Contact, nodes: list[int], below: Bools, friction: Floats, along: Floats) -> float:
    """Friction at a corner, from the node next to it and the one beyond, or its own if that sticks."""
    i = nodes[-1] if below[nodes[0]] else nodes[0]
    out = contact.points - contact.points[i]
    far = out @ along
    straight = np.linalg.norm(out - far[:, None] * along, axis=1) < 1e-9 * far
    # What is known at the corner itself tells how far that is.
    beyond = np.flatnonzero(straight & ~below & (friction * friction[i] > 0.0))
    if i == nodes[-1] or len(beyond) == 0:
        return float(friction[i])
    after = int(beyond[np.argmin(far[beyond])])
    step = float((contact.points[i] - contact.points[nodes[-1]]) @ along)
    return float(friction[i] + (friction[i] - friction[after]) * step / far[after])
