r"""A membrane with friction: Problem 2.1 of Feng, Han and Huang with the Laplacian, on scalar virtual elements.

The displacement u under the load f and the friction lambda with the bound g obeys

$$
-\Delta u + \lambda = f, \qquad |\lambda| \le g,
\qquad \lambda = g \operatorname{sign}(u') \text{ wherever } u' \ne 0,
$$

with the velocity u'. On one part of the boundary u = 0, and on another part grad u . n = q(t). The friction lambda acts
per area (a membrane on a rough table) or per length of a part of the boundary (there grad u . n + lambda = q). The
tension is one. In the weak form a(u, v) = int grad u . grad v and j(v) = int g |v|.

**Virtual elements** (Ahmad et al., Comput. Math. Appl. 66, 2013; Beirao da Veiga et al., M3AS 23, 2013). With the mean
gradient G_i of each vertex function and the projection Pi of :mod:`vemcvx.vem.projection`, a cell of area A has the
stiffness

$$ K_{ij} = A G_i\cdot G_j + ((I - \Pi)'(I - \Pi))_{ij} \qquad (\text{dofi-dofi}). $$

Each vertex of a cell gets an equal part of the integral of f over the cell. The bound g is distributed in the same way.

**Exact on every mesh: a strip pulled at its rough edge.** The strip (0, L) x (0, H) has u = 0 on top. The load q(t)
pulls the lower edge, friction opposes the motion, and the edge has the displacement u = a. The sides are free. Then
u = a (1 - y/H), lambda = q - a/H, and after step n

$$ a_n = \operatorname{clip}(a_{n-1}, H (q_n - g), H (q_n + g)). $$

Virtual elements reproduce u, because u is linear. A closed loop between q = -Q and q = Q dissipates 4 g L H (Q - g).

**Exact up to O(h): a membrane on a rough table.** The membrane (0, L) x (0, H) is held at x = L and pulled by q(t) at
x = 0. The other sides are free. Friction has the bound g per area. Friction reduces T = -du/dx, the force per length,
as x grows. Let play_r(q) stay within the distance r of q, and change only if it must. Then

$$ T(x, t) = \operatorname{play}_{g x}(q)(t), \qquad u(x, t) = \int_x^L T, \qquad \lambda = -dT / dx. $$

On first loading the zone x < q/g slips, and $u = (q - g x)_+^2 / 2g$, where $(s)_+ = \max(s, 0)$. After a reversal by
dq the zone x < dq/2g slips back, and u changes by $(dq - 2 g x)_+^2 / 4g$. At larger x the friction of the first
loading stays. A closed loop between pulls that differ by dq dissipates dq^3 / (12 g) per unit width. Only the second
derivative of u jumps, so that the error in the energy norm is O(h).

    python problems/membrane_with_friction.py --picture membrane_with_friction.png
"""

import argparse
import time
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

import vemcvx as vx
from spring_slider_chain import course, sample, turning_instants
from vemcvx.vem import Space
from vemcvx.vem.stabilisation import products_of_remainder

LENGTH, HEIGHT, BOUND = 1.0, 0.5, 2.0
TURNS = (0, 1.75, -1.25, 1.25)
"""Turning points of the pull q on the table; if |q| < g L, slip does not reach the held end."""
PEAK = 5.0
EDGE_PULL = course((0, PEAK, -PEAK, PEAK), first=2.5)
"""Pull q at the rough edge of the strip; the peaks `PEAK` exceed g."""


class Membrane(NamedTuple):
    """A system, with the nodes of its unknowns and of its friction terms."""

    system: vx.System
    free: np.ndarray
    """Nodes of the unknowns."""
    rough: np.ndarray
    """Nodes of the friction terms."""
    measures: np.ndarray
    """The area or the length on which friction acts, for each node of `rough`."""


def scalar_stiffness(mesh):
    """Return the matrix of int grad u . grad v, one unknown per node."""
    rows, columns, values = [], [], []
    for group in Space(mesh).groups:
        areas, g = group.gradients()
        local = g @ g.transpose(0, 2, 1) / areas[:, None, None]
        if g.shape[1] > 3:
            local += products_of_remainder(group.vertex_values())
        rows.append(np.repeat(group.nodes, g.shape[1], axis=1).ravel())
        columns.append(np.tile(group.nodes, g.shape[1]).ravel())
        values.append(local.ravel())
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sp.coo_matrix(entries, shape=(mesh.n_nodes, mesh.n_nodes)).tocsr()


def node_areas(mesh):
    """Return the area that belongs to each node: every vertex of a cell gets an equal part of the cell."""
    corners = np.diff(mesh.offsets)
    return np.bincount(mesh.vertices, weights=np.repeat(mesh.areas / corners, corners), minlength=mesh.n_nodes)


def node_lengths(mesh, on):
    """Return the length that belongs to each node of a part of the boundary, zero at other nodes."""
    part = Space(mesh).part(on, "membrane")
    lengths = np.zeros(mesh.n_nodes)
    lengths[part.nodes] = part.node_lengths
    return lengths


def membrane(mesh, pull, held, pulled, rough, bound=BOUND):
    """Return a membrane, held on the part `held` and pulled on the part `pulled`; `pull` has a value per instant.

    `rough` (n_nodes,) has the areas or lengths on which friction acts at the nodes, zero at nodes without friction.
    """
    free = np.setdiff1d(np.arange(mesh.n_nodes), Space(mesh).part(held, "membrane").nodes)
    K = scalar_stiffness(mesh)[free][:, free]
    load = node_lengths(mesh, pulled)[free]
    places = np.flatnonzero(rough[free] > 0)
    B = sp.identity(len(free), format="csr")[places]
    norms = vx.Norms(B, bound * rough[free[places]])
    system = vx.System(K, lambda t: load * sample(pull)(t), norms)
    return Membrane(system, free, free[places], rough[free[places]])


def pose_strip(mesh, pull):
    """Return the strip, which is held on top and pulled at its lower edge against friction."""
    return membrane(mesh, pull, "top", "bottom", node_lengths(mesh, "bottom"))


def solve_strip_exactly(pull, bound=BOUND, height=HEIGHT):
    """Return the displacement a (N + 1,) of the rough edge and its friction lambda (N + 1,) per length."""
    a = np.zeros(len(pull))
    for n in range(1, len(pull)):
        a[n] = np.clip(a[n - 1], height * (pull[n] - bound), height * (pull[n] + bound))
    return a, pull - a / height


def pose_on_table(mesh, pull):
    """Return the membrane on the table, which is held at the right, pulled at the left and rough everywhere."""
    return membrane(mesh, pull, "right", "left", node_areas(mesh))


def solve_table_exactly(x, turns=TURNS, bound=BOUND):
    """Return u and lambda at turning points, (len(turns), len(x)). Slip zones must not grow from turn to turn."""
    u, friction = np.zeros((len(turns), len(x))), np.zeros((len(turns), len(x)))
    for n, swing in enumerate(np.diff(turns), start=1):
        # Friction rises from 0 to g in the first loading, and from -g to g after a reversal.
        rise = 1 if n == 1 else 2
        rest = np.maximum(abs(swing) - rise * bound * x, 0.0)
        u[n] = u[n - 1] + np.sign(swing) * rest**2 / (2 * rise * bound)
        friction[n] = np.where(rest > 0, np.sign(swing) * bound, friction[n - 1])
    return u, friction


def table_dissipation(turns=TURNS, bound=BOUND, height=HEIGHT):
    """Return the dissipation (len(turns),) up to each turning point: the integral of g |du| over the table."""
    swings = np.abs(np.diff(turns))
    rise = np.where(np.arange(len(swings)) == 0, 1, 2)
    return np.append(0.0, np.cumsum(height * swings**3 / (6 * rise**2 * bound)))


def solve_on_table(mesh, increment=0.5, solver=None):
    """Return the membrane, its trajectory, and the steps of the turning points."""
    pull = course(TURNS, increment)
    posed = pose_on_table(mesh, pull)
    # Friction acts on nearly every unknown. Eliminating the few other unknowns would leave a large dense matrix.
    trajectory = vx.march(posed.system, np.arange(float(len(pull))), solver=solver, condense=False)
    return posed, trajectory, turning_instants(pull, TURNS)


def energy_error(posed, trajectory, at, points):
    """Return |u_h - I u|_a / max |I u|_a at the turning points; I u has the nodal values of the exact u."""
    exact, _ = solve_table_exactly(points[posed.free, 0])
    off, K = trajectory.state[at] - exact, posed.system.K
    size = np.einsum("ni,ni->n", exact, (K @ exact.T).T)
    return np.sqrt(np.einsum("ni,ni->n", off, (K @ off.T).T) / size.max())


def picture(path, mesh, posed, trajectory, at):
    """Draw displacements on the table at the turning points, and friction after the reversal, beside closed forms."""
    from vemcvx.base.canvas import new_figure
    from vemcvx.plots.style import MARKERS, SERIES

    figure = new_figure(9.0, 4.2)
    left, right = figure.subplots(1, 2)
    x = np.linspace(0, LENGTH, 801)
    u, friction = solve_table_exactly(x)
    density = trajectory.multipliers[:, :, 0] / posed.measures
    free, rough = mesh.points[posed.free, 0], mesh.points[posed.rough, 0]
    some, few = (np.argsort(places)[:: max(1, len(places) // 40)] for places in (free, rough))
    for k in range(1, len(TURNS)):
        left.plot(x, u[k], "k-", linewidth=1, label=None if k > 1 else "closed form")
        mark = {"color": SERIES[k], "marker": MARKERS[k], "fillstyle": "none", "markersize": 5}
        left.plot(free[some], trajectory.state[at[k]][some], linestyle="none", **mark, label=f"pull {TURNS[k]:g}")
    right.plot(x, friction[2], "k-", linewidth=1, label="closed form")
    marks = {"linestyle": "none", "fillstyle": "none", "marker": MARKERS[2], "color": SERIES[2], "markersize": 5}
    right.plot(rough[few], density[at[2]][few], **marks, label="multipliers / area")
    left.set(xlabel="x", ylabel="u")
    left.set_title("at 40 nodes of a Voronoi mesh, at the turning points", fontsize="medium")
    right.set(xlabel="x", ylabel="friction per area")
    right.set_title(f"after the reversal, at pull {TURNS[2]:g}", fontsize="medium")
    for ax in (left, right):
        ax.legend(frameon=False)
    figure.savefig(path, dpi=120)


def main(path=None):
    box = ((0.0, LENGTH), (0.0, HEIGHT))
    pull = EDGE_PULL
    a, friction = solve_strip_exactly(pull)
    mesh = vx.meshes.voronoi(8, box)
    posed = pose_strip(mesh, pull)
    print("strip with a rough edge, exact on every mesh (Voronoi)")
    print("solver      error of u   certified   lambda error   dissipated in a loop   seconds")
    for solver in (vx.Newton(), vx.Clarabel(), vx.OSQP()):
        start = time.perf_counter()
        trajectory = vx.march(posed.system, np.arange(float(len(pull))), solver=solver)
        seconds = time.perf_counter() - start
        exact = a[:, None] * (1 - mesh.points[posed.free, 1] / HEIGHT)
        density = trajectory.multipliers[:, :, 0] / posed.measures
        lost = trajectory.dissipated[-1] - trajectory.dissipated[np.argmax(pull)]
        print(
            f"{solver.name:9s}{np.abs(trajectory.state - exact).max():12.1e}{trajectory.certificate_total[-1]:12.1e}"
            f"{np.abs(density - friction[:, None]).max():15.1e}{lost:23.8f}{seconds:10.2f}"
        )
    print(f"in closed form: dissipated in a loop {4 * BOUND * LENGTH * HEIGHT * (PEAK - BOUND):g}")
    print("membrane on a rough table: relative errors in the energy norm at the turning points, dissipation, seconds")
    for n in (4, 8, 16, 32):
        mesh = vx.meshes.voronoi(n, box)
        posed, trajectory, at = solve_on_table(mesh)
        errors = energy_error(posed, trajectory, at, mesh.points)
        words = "".join(f"{e:11.2e}" for e in errors[1:])
        print(f"h = {mesh.h:.3f}{words}   {trajectory.dissipated[-1]:.5f} {trajectory.seconds['solve']:.2f} s")
    print(f"in closed form: dissipated {table_dissipation()[-1]:.5f}")
    if path:
        picture(path, mesh, posed, trajectory, at)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", metavar="FILE")
    main(parser.parse_args().picture)
