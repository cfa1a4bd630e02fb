"""Frictional contact on linear triangles, implemented independently with scikit-fem, cvxpy and Clarabel.

This module does not use the package. Let n_j be outward normals, and let the tangents t_i be normals rotated by +90
degrees. A step of backward Euler is a convex program in all nodal displacements u,

    minimise  1/2 u'Ku + 1/(2k) (u - u_prev)'C(u - u_prev) - f'u + sum_i w_i |s_i|,   s_i = t_i.(u - u_prev),
              + sum_j c_j/2 (n_j.u - gap_j)_+^2  over compliant obstacles with the stiffness c_j
    subject to  E u = h  at supports,   n_j.u <= gap_j  at rigid obstacles,

in a step of length k, with stiffness K, viscosity C, loads f and friction bounds w. Clarabel solves the program. A
dense linear system then gives the solution on the active sets of Clarabel's answer, and all inequalities are checked.
Coulomb's friction, w = mu p with pressures p, needs a fixed-point iteration.

Friction exerts the nodal force -lam_i t_i on the body, with |lam_i| <= w_i, and the obstacle exerts -p_j n_j.
"""

from __future__ import annotations

import contextlib
import warnings
from dataclasses import dataclass, field
from itertools import pairwise

import cvxpy as cp
import numpy as np
import skfem
from skfem.helpers import ddot, div, dot, sym_grad, trace

AGREE = 1e-8
"""Largest relative difference between results of this module and of the package."""
TIMES = np.array([0.0, 0.1, 0.25, 0.4, 0.6, 0.65, 0.9])
FIXED_POINT = 1e-13
MOST_PROGRAMS = 200
MOST_SETS = 30


@skfem.BilinearForm
def isotropic(u, v, w):
    return w.lam * trace(sym_grad(u)) * trace(sym_grad(v)) + 2 * w.mu * ddot(sym_grad(u), sym_grad(v))


@skfem.BilinearForm
def anisotropic(u, v, w):
    e, g = ([q[0, 0], q[1, 1], 2 * q[0, 1]] for q in (sym_grad(u), sym_grad(v)))
    return sum(w[f"c{i}{j}"] * e[i] * g[j] for i in range(3) for j in range(3))


@skfem.LinearForm
def swelling(v, w):
    return w.sigma * div(v)


@skfem.LinearForm
def stressed(v, w):
    e = sym_grad(v)
    return w.xx * e[0, 0] + w.yy * e[1, 1] + 2 * w.xy * e[0, 1]


def vector(force):
    """Return force(x, y, t) as a function of points (m, 2) and t."""
    return lambda x, t: np.column_stack([f + 0 * x[:, 0] for f in force(x[:, 0], x[:, 1], t)])


def scalar(value):
    """Return value(x, y, t) as a function of points (m, 2) and t."""
    return lambda x, t: value(x[:, 0], x[:, 1], t) + 0 * x[:, 0]


class NotPolished(AssertionError):
    """Raised if no active sets satisfy all optimality conditions."""


@dataclass
class Rows:
    """Directions at nodes: row i is direction_i . u(node_i). `lengths` are integrals of nodal basis functions.

    Between bodies, row i is direction_i . (u(node_i) - u(partner_i)).
    """

    nodes: np.ndarray
    directions: np.ndarray
    lengths: np.ndarray
    partners: np.ndarray = None

    def matrix(self, n_nodes):
        out = np.zeros((len(self.nodes), n_nodes, 2))
        out[np.arange(len(self.nodes)), self.nodes] = self.directions
        if self.partners is not None:
            out[np.arange(len(self.nodes)), self.partners] -= self.directions
        return out.reshape(len(self.nodes), -1)


@dataclass
class Body:
    """An elastic box with a mesh of linear triangles."""

    points: np.ndarray
    triangles: np.ndarray
    lam: object = 0.0
    K: np.ndarray = None
    C: np.ndarray = None
    loads: list = field(default_factory=list)
    held: list = field(default_factory=list)
    """prescribed values: (node, direction, t -> value)"""
    obstacles: list = field(default_factory=list)
    """(rows, t -> gap, stiffness or None)"""
    rubs: list = field(default_factory=list)
    """friction: (rows, t -> bound, coefficient)"""

    def __post_init__(self):
        self.mesh = skfem.MeshTri(self.points.T.copy(), self.triangles.T.copy())
        self.basis = skfem.Basis(self.mesh, skfem.ElementVector(skfem.ElementTriP1()), intorder=2)
        self.scalar = skfem.Basis(self.mesh, skfem.ElementTriP1(), intorder=2)
        self.n = len(self.points)
        # scikit-fem's indices of both components at each node
        self.order = self.basis.nodal_dofs.T.ravel()
        self.K, self.C = np.zeros((2 * self.n, 2 * self.n)), np.zeros((2 * self.n, 2 * self.n))
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        at = {"left": (0, low[0]), "right": (0, high[0]), "bottom": (1, low[1]), "top": (1, high[1])}
        self.sides = {
            name: self.mesh.facets_satisfying(lambda x, a=a, c=c: np.abs(x[a] - c) < 1e-9, boundaries_only=True)
            for name, (a, c) in at.items()
        }
        self.normals = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "bottom": (0.0, -1.0), "top": (0.0, 1.0)}
        self.centroids = self.points[self.triangles].mean(axis=1)

    # Assembly

    def _matrix(self, form, **data):
        cells = {name: np.broadcast_to(np.reshape(v, (-1, 1)), (len(self.triangles), 3)) for name, v in data.items()}
        return form.assemble(self.basis, **cells).toarray()[np.ix_(self.order, self.order)]

    def _vector(self, form, basis, **data):
        return form.assemble(basis, **data)[self.order]

    def nodes(self, side):
        return np.unique(self.mesh.facets[:, self.sides[side]])

    def rows(self, side, tangents=False):
        """Return normals (or tangents) at the nodes of a side."""
        basis = skfem.FacetBasis(self.mesh, skfem.ElementTriP1(), facets=self.sides[side], intorder=4)
        lengths = skfem.LinearForm(lambda v, w: v).assemble(basis)
        nodes, n = self.nodes(side), np.array(self.normals[side])
        direction = np.array([-n[1], n[0]]) if tangents else n
        return Rows(nodes, np.tile(direction, (len(nodes), 1)), lengths[nodes])

    def integral(self, side, g):
        """Return the integrals of a polynomial g times nodal basis functions over a side."""
        basis = skfem.FacetBasis(self.mesh, skfem.ElementTriP1(), facets=self.sides[side], intorder=8)
        return skfem.LinearForm(lambda v, w: g(np.array(w.x)) * v).assemble(basis)[self.nodes(side)]

    # Physics

    def isotropic(self, young, poisson, plane="strain"):
        young, poisson = (np.broadcast_to(v, len(self.triangles)).astype(float) for v in (young, poisson))
        mu = young / 2 / (1 + poisson)
        lam = young * poisson / (1 + poisson) / (1 - 2 * poisson)
        self.blocked = young / (1 - 2 * poisson)
        if plane == "stress":
            lam, self.blocked = young * poisson / (1 - poisson**2), young / (1 - poisson)
        self.K = self.K + self._matrix(isotropic, lam=lam, mu=mu)
        return self

    def orthotropic(self, E1, E2, nu12, G, angle):
        """Set an orthotropic material in plane stress, with axis 1 at an angle from x."""
        compliance = np.array([[1 / E1, -nu12 / E1, 0], [-nu12 / E1, 1 / E2, 0], [0, 0, 1 / G]])
        c, s = np.cos(angle), np.sin(angle)
        # `turn` maps stresses in x, y to stresses in material axes.
        turn = np.array([[c * c, s * s, 2 * c * s], [s * s, c * c, -2 * c * s], [-c * s, c * s, c * c - s * s]])
        law = np.linalg.inv(turn) @ np.linalg.inv(compliance) @ np.linalg.inv(turn).T
        self.K = self.K + self._matrix(anisotropic, **{f"c{i}{j}": law[i, j] for i in range(3) for j in range(3)})
        return self

    def viscous(self, shear, volume):
        self.C = self.C + self._matrix(isotropic, lam=volume, mu=shear)
        return self

    def springs(self, side, normal, tangential):
        basis = skfem.FacetBasis(self.mesh, self.basis.elem, facets=self.sides[side], intorder=4)

        @skfem.BilinearForm
        def form(u, v, w):
            un, vn = dot(u, w.n), dot(v, w.n)
            return normal * un * vn + tangential * (dot(u, v) - un * vn)

        self.K = self.K + form.assemble(basis).toarray()[np.ix_(self.order, self.order)]
        return self

    def traction(self, side, force):
        """Add a traction, force(x, y, t) -> two components."""
        basis = skfem.FacetBasis(self.mesh, self.basis.elem, facets=self.sides[side], intorder=6)

        def load(t):
            def form(v, w):
                fx, fy = force(w.x[0], w.x[1], t)
                return fx * v[0] + fy * v[1]

            return self._vector(skfem.LinearForm(form), basis)

        self.loads.append(load)
        return self

    def pressure(self, side, value):
        n = self.normals[side]
        return self.traction(side, lambda x, y, t: (-value(x, y, t) * n[0], -value(x, y, t) * n[1]))

    def body_force(self, force):
        """Add a body force, evaluated at centroids."""

        def load(t):
            x, y = self.centroids.T
            fx, fy = (np.broadcast_to(np.reshape(f + 0 * x, (-1, 1)), (len(x), 3)) for f in force(x, y, t))
            return self._vector(skfem.LinearForm(lambda v, w: w.fx * v[0] + w.fy * v[1]), self.basis, fx=fx, fy=fy)

        self.loads.append(load)
        return self

    def heat(self, expansion, temperature):
        def load(t):
            sigma = self.blocked * expansion * temperature(*self.centroids.T, t)
            return self._vector(swelling, self.basis, sigma=np.broadcast_to(sigma[:, None], (len(sigma), 3)))

        self.loads.append(load)
        return self

    def prestress(self, stress):
        """Add the load -int sigma : eps(v) of an initial stress sigma, with xx, yy, xy = stress(x, y, t)."""

        def load(t):
            x, y = self.centroids.T
            parts = [np.broadcast_to(np.reshape(s + 0 * x, (-1, 1)), (len(x), 3)) for s in stress(x, y, t)]
            return -self._vector(stressed, self.basis, xx=parts[0], yy=parts[1], xy=parts[2])

        self.loads.append(load)
        return self

    def point_force(self, node, force):
        def load(t):
            f = np.zeros(2 * self.n)
            f[2 * node : 2 * node + 2] = force(t)
            return f

        self.loads.append(load)
        return self

    def move(self, side, value):
        """Add a support with both components prescribed, u = value(x, y, t)."""
        for node in self.nodes(side):
            x, y = self.points[node]
            for a in range(2):
                self.held.append((node, np.eye(2)[a], lambda t, x=x, y=y, a=a: value(x, y, t)[a]))
        return self

    def guide(self, side, direction, value):
        """Add a support with one component prescribed, direction . u = value(x, y, t)."""
        for node in self.nodes(side):
            x, y = self.points[node]
            self.held.append((node, np.asarray(direction, float), lambda t, x=x, y=y: value(x, y, t)))
        return self

    def clamp(self, side):
        return self.move(side, lambda x, y, t: (0.0, 0.0))

    def bilateral(self, side):
        """Add bilateral contact, n . u = 0, at nodes without another prescribed value."""
        for node in self.nodes(side):
            if not any(other == node for other, _, _ in self.held):
                self.held.append((node, np.array(self.normals[side]), lambda t: 0.0))
        return self

    def wall(self, side, gap=None, stiffness=None):
        """Add an obstacle, n . u <= gap(x, y, t), rigid or with a stiffness per area."""
        rows = self._free(self.rows(side))
        x, y = self.points[rows.nodes].T
        self.obstacles.append((rows, lambda t: 0 * x if gap is None else gap(x, y, t) + 0 * x, stiffness))
        return self

    def rub(self, side, bound=None, coefficient=None, integrated=False):
        """Add friction. The bound is bound(x, y, t), or coefficient(x, y) times the pressure."""
        rows = self._free(self.rows(side, tangents=True))
        x, y = self.points[rows.nodes].T

        def weights(t):
            if integrated:
                which = np.isin(self.nodes(side), rows.nodes)
                return self.integral(side, lambda X: bound(X[0], X[1], t))[which]
            return rows.lengths * (bound(x, y, t) + 0 * x)

        self.rubs.append((rows, weights, None) if coefficient is None else (rows, None, coefficient(x, y) + 0 * x))
        return self

    def _free(self, rows):
        """Return the rows that prescribed values do not determine, and all rows between bodies."""
        if rows.partners is not None:
            return rows
        keep = []
        for node, direction in zip(rows.nodes, rows.directions, strict=True):
            fixed = np.array([d for other, d, _ in self.held if other == node]).reshape(-1, 2).T
            left = direction - fixed @ np.linalg.lstsq(fixed, direction, rcond=None)[0]
            keep.append(np.linalg.norm(left) > 1e-9)
        return Rows(rows.nodes[keep], rows.directions[keep], rows.lengths[keep])


class Bodies(Body):
    """A stack of boxes. Sides are named like "lower.left", and interfaces like "lower|upper"."""

    def __init__(self, points, triangles, body_of_triangle, names):
        super().__init__(points, triangles)
        self.joined = {}
        around, self.sides, self.normals = self.normals, {}, {}
        for k, name in enumerate(names):
            own = np.unique(triangles[body_of_triangle == k])
            low, high = points[own].min(axis=0), points[own].max(axis=0)
            for side, a, c in (("left", 0, low), ("right", 0, high), ("bottom", 1, low), ("top", 1, high)):
                facets = np.flatnonzero(np.isin(self.mesh.facets, own).all(axis=0) & (self.mesh.f2t[1] < 0))
                on = np.abs(points[self.mesh.facets[:, facets], a] - c[a]).max(axis=0) < 1e-9
                self.sides[f"{name}.{side}"], self.normals[f"{name}.{side}"] = facets[on], around[side]
        for below, above in pairwise(names):
            joint, there = f"{below}|{above}", self.nodes(f"{above}.bottom")
            self.sides[joint], self.normals[joint] = self.sides[f"{below}.top"], (0.0, 1.0)
            self.joined[joint] = {
                i: there[np.abs(points[there] - points[i]).max(axis=1).argmin()] for i in self.nodes(joint)
            }

    def rows(self, side, tangents=False):
        rows = super().rows(side, tangents)
        if side in self.joined:
            rows.partners = np.array([self.joined[side][i] for i in rows.nodes])
        return rows


@dataclass
class State:
    """The state at one instant."""

    u: np.ndarray
    lam: np.ndarray
    p: np.ndarray
    q: np.ndarray
    """reactions along prescribed directions"""
    sets: tuple = ()
    """slip directions of friction rows (0 for sticking rows), and a mask of active obstacles"""


@dataclass
class Result:
    """The history of a body: arrays whose first axis is time."""

    displacement: np.ndarray
    lam: np.ndarray
    pressures: np.ndarray
    forces: np.ndarray
    """nodal forces on the body from supports, obstacles and friction, K u + C u' - f"""
    energy: np.ndarray
    dissipated: np.ndarray
    work: np.ndarray
    slipping: np.ndarray
    touching: np.ndarray


class March:
    """Backward Euler for a body."""

    def __init__(self, body):
        self.body, n = body, body.n
        stack = lambda rows: np.vstack([r.matrix(n) for r in rows]) if rows else np.zeros((0, 2 * n))  # noqa: E731
        self.T, self.N = stack([r[0] for r in body.rubs]), stack([r[0] for r in body.obstacles])
        self.E = np.zeros((len(body.held), 2 * n))
        for i, (node, direction, _) in enumerate(body.held):
            self.E[i, 2 * node : 2 * node + 2] = direction
        lengths = [np.full(len(r.nodes), np.inf if k is None else k) * r.lengths for r, _, k in body.obstacles]
        self.spring = np.concatenate(lengths) if lengths else np.zeros(0)
        self.soft = np.isfinite(self.spring)
        self.press = self._find_pressing_walls()

    def _find_pressing_walls(self):
        """Return the friction coefficients (friction rows, obstacle rows)."""
        out = []
        for rows, _, mu in self.body.rubs:
            found = np.zeros((len(rows.nodes), len(self.spring)))
            if mu is not None:
                column = 0
                for wall, _, _ in self.body.obstacles:
                    for j, node in enumerate(wall.nodes):
                        across = np.abs(np.einsum("d,id->i", wall.directions[j], rows.directions)) < 1e-9
                        found[(rows.nodes == node) & across, column + j] = mu[(rows.nodes == node) & across]
                    column += len(wall.nodes)
            out.append(found)
        return np.vstack(out) if out else np.zeros((0, len(self.spring)))

    def gaps(self, t):
        return np.concatenate([np.zeros(0), *(gap(t) for _, gap, _ in self.body.obstacles)])

    def bounds(self, t, p):
        """Return the friction bounds as nodal forces."""
        parts = [np.zeros(len(rows.nodes)) if weights is None else weights(t) for rows, weights, _ in self.body.rubs]
        return np.concatenate([np.zeros(0), *parts]) + self.press @ p

    def load(self, t):
        return sum((load(t) for load in self.body.loads), np.zeros(2 * self.body.n))

    def held(self, t):
        return np.array([float(value(t)) for _, _, value in self.body.held])

    def run(self, times):
        body = self.body
        now = State(np.zeros(2 * body.n), np.zeros(len(self.T)), np.zeros(len(self.N)), np.zeros(len(self.E)))
        states, forces, loss, work = [now], [np.zeros(2 * body.n)], [0.0], [0.0]
        for s, t in pairwise(times):
            before, now = now, self._solve_step(now, s, t)
            du, f, k = now.u - before.u, self.load(t), t - s
            rubbed = self.bounds(t, now.p) @ np.abs(self.T @ du)
            forces.append(body.K @ now.u + body.C @ du / k - f)
            moved = self.held(t) - self.held(s) if len(self.E) else np.zeros(0)
            pushed = now.p @ (self.gaps(t) - self.gaps(s))
            loss.append(loss[-1] + rubbed + du @ (body.C @ du) / k)
            work.append(work[-1] + f @ du - now.q @ moved - pushed)
            states.append(now)
        # A spring with the stiffness k and the force p stores p^2 / 2k.
        give = np.divide(1.0, self.spring, out=np.zeros_like(self.spring), where=self.soft)
        stored = [0.5 * float(s.u @ (body.K @ s.u) + s.p @ (give * s.p)) for s in states]
        U = np.array([s.u for s in states])
        slips = np.abs(np.diff(U, axis=0) @ self.T.T)
        return Result(
            U.reshape(len(times), -1, 2),
            np.array([s.lam for s in states]),
            np.array([s.p for s in states]),
            np.array(forces).reshape(len(times), -1, 2),
            np.array(stored),
            np.array(loss),
            np.array(work),
            slips > 1e-12 * np.abs(U).max(),
            np.array([s.p for s in states]) > 0,
        )

    def _solve_step(self, before, s, t):
        """Solve a step: a convex program, or a fixed point of convex programs."""
        if not self.press.any():
            return self._solve_program(before, s, t, self.bounds(t, before.p))
        # Start from the pressures under very large friction.
        tight = 10 * np.abs(self.load(t)).sum() * np.ones(len(self.T)) * (self.press.sum(axis=1) > 0)
        p, state = self._solve_program(before, s, t, tight).p, None
        for _ in range(MOST_PROGRAMS):
            state = self._solve_program(before, s, t, self.bounds(t, p), state)
            change = np.abs(state.p - p).max()
            p = state.p
            if change <= FIXED_POINT * max(np.abs(p).max(), 1e-300):
                return state
        raise AssertionError(f"Coulomb's fixed point did not converge at t = {t}: {change}")

    def _solve_program(self, before, s, t, bounds, near=None):
        """Solve a convex program. The first sets come from the state `near`, by default from Clarabel's answer."""
        body, k = self.body, t - s
        H = body.K + body.C / k
        f, gap, h = self.load(t) + body.C @ before.u / k, self.gaps(t), self.held(t)
        problem = H, f, gap, h, bounds, self.T @ before.u
        sets = self._solve_with_clarabel(*problem) if near is None else near.sets
        return self._polish(*problem, sets)

    def _solve_with_clarabel(self, H, f, gap, h, bounds, b):
        """Return the sets of Clarabel's answer."""
        unit = np.abs(np.linalg.lstsq(H, f, rcond=1e-12)[0]).max() + np.abs(h).max(initial=0.0)
        unit = unit if unit > 0 else 1.0
        scale = np.abs(H.diagonal()).max()
        force = scale * unit
        u, over = cp.Variable(len(f)), cp.Variable(int(self.soft.sum()) or 1, nonneg=True)
        slip = self.T @ u - b / unit
        way = cp.Variable(len(self.T) or 1)
        cost = 0.5 * cp.quad_form(u, cp.psd_wrap(H / scale)) - (f / force) @ u
        rules, split, rigid = [], None, None
        if len(self.T):
            split = slip == way
            rules, cost = [*rules, split], cost + (bounds / force) @ cp.abs(way)
        if len(self.E):
            rules.append(self.E @ u == h / unit)
        if len(self.N):
            room = self.N @ u - gap / unit
            if self.soft.any():
                rules.append(room[np.flatnonzero(self.soft)] <= over)
                cost = cost + 0.5 * cp.sum_squares(cp.multiply(np.sqrt(self.spring[self.soft] / scale), over))
            if (~self.soft).any():
                rigid = room[np.flatnonzero(~self.soft)] <= 0
                rules.append(rigid)
        for tolerance in (1e-13, 1e-11, 1e-9):
            names = "tol_gap_abs", "tol_gap_rel", "tol_feas"
            # Clarabel may fail or stop early. `_polish` corrects the answer.
            with warnings.catch_warnings(), contextlib.suppress(cp.SolverError):
                warnings.simplefilter("ignore")
                cp.Problem(cp.Minimize(cost), rules).solve(
                    solver=cp.CLARABEL, max_iter=200, **dict.fromkeys(names, tolerance)
                )
            if u.value is not None:
                break
        s = self.T @ u.value - b / unit
        lam = np.asarray(split.dual_value) if split is not None else np.zeros(0)
        room = self.N @ u.value - gap / unit
        acts = room > 0
        if rigid is not None:
            acts[~self.soft] = np.asarray(rigid.dual_value) > -room[~self.soft]
        # A row sticks if |slip| <= bound - |multiplier|.
        return np.where(np.abs(s) <= bounds / force - np.abs(lam), 0, np.sign(s)).astype(int), acts

    def _polish(self, H, f, gap, h, bounds, b, sets):
        """Solve the optimality conditions on the sets, and correct the sets."""
        sign, acts = sets
        n = len(f)
        for _ in range(MOST_SETS):
            stick, hard = np.flatnonzero(sign == 0), np.flatnonzero(acts & ~self.soft)
            bent = np.flatnonzero(acts & self.soft)
            slides = sign * bounds
            stiff = H + self.N[bent].T @ (self.spring[bent, None] * self.N[bent])
            right = f - self.T.T @ slides + self.N[bent].T @ (self.spring[bent] * gap[bent])
            A = np.vstack([self.E, self.T[stick], self.N[hard]])
            c = np.concatenate([h, b[stick], gap[hard]])
            x = _solve_saddle_point(stiff, A, right, c)
            u, m = x[:n], x[n:]
            q, lam, p = m[: len(self.E)], slides.copy(), np.zeros(len(self.N))
            lam[stick] = m[len(self.E) : len(self.E) + len(stick)]
            p[hard] = m[len(self.E) + len(stick) :]
            room, slip = self.N @ u - gap, self.T @ u - b
            p[bent] = self.spring[bent] * room[bent]
            size, force = np.abs(u).max() + 1e-300, np.abs(H @ u).max() + np.abs(f).max() + 1e-300
            little, weak = 1e-12 * size, 1e-12 * force
            new_sign = sign.copy()
            held = sign == 0
            new_sign[held & (lam > bounds + weak)] = 1
            new_sign[held & (lam < -bounds - weak)] = -1
            new_sign[(sign > 0) & (slip < -little)] = 0
            new_sign[(sign < 0) & (slip > little)] = 0
            new_acts = np.where(acts, p > -weak, room > little)
            if (new_sign == sign).all() and (new_acts == acts).all():
                return State(u, lam, p, q, (sign, acts))
            sign, acts = new_sign, new_acts
        raise NotPolished("no sets satisfy all conditions")


def _solve_saddle_point(H, A, f, c):
    """Solve H x + A'm = f, A x = c, with one step of refinement."""
    n, k = len(f), len(c)
    M = np.zeros((n + k, n + k))
    size = H.diagonal().max()
    M[:n, :n], M[:n, n:], M[n:, :n] = H / size, A.T, A
    right = np.concatenate([f / size, c])
    x = np.linalg.solve(M, right)
    x = x + np.linalg.solve(M, right - M @ x)
    return np.concatenate([x[:n], size * x[n:]])
