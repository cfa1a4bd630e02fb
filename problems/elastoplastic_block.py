r"""A block that yields by the criterion of von Mises: each cell has one second-order cone.

The block is in plane strain (Han and Reddy, Plasticity, chapter 7). The plastic strain P is symmetric and traceless,
P = p_1 N_1 + p_2 N_2 + p_3 N_3 in the orthonormal basis

$$
N_1 = \operatorname{diag}(1, -1, 0) / \sqrt{2}, \qquad N_2 = \operatorname{diag}(1, 1, -2) / \sqrt{6},
\qquad N_3 = (e_x e_y' + e_y e_x') / \sqrt{2},
$$

where only N_2 has a component zz; the strain eps has none. Let mu be the shear modulus, s = 2 mu (dev eps - P) the
deviator of the stress, C the elasticity tensor, H the hardening modulus and sigma_y the yield stress. Let P' be the
rate of P. The stored energy and the loss per volume, and the yield criterion, are

$$
\text{stored} \qquad 1 / 2 (\varepsilon - P):C (\varepsilon - P) + H / 2 |P|^2,
\qquad \text{loss} \qquad R |P'|, \qquad |s - H P| \le R = \sqrt{2/3} \sigma_y.
$$

On virtual elements P is constant on each cell K of the area |K|. P couples to the deviatoric strain of Pi u, where Pi
projects on linear fields. The unknowns are u and the coordinates p of P. Let v and q be test functions, and a_K^h the
elastic form of a cell. The form a of a cell, the loss j of the block and the multiplier lambda_K of a cell are

$$
a((u, p), (v, q)) = a_K^h(u, v) - |K| 2 \mu(p\cdot N:\varepsilon(\Pi v) + q\cdot N:\varepsilon(\Pi u)) + |K| (2 \mu
+ H) p\cdot q, \\
j(v, q) = \sum_K |K| R |q_K|, \qquad \lambda_K = |K| (s - H P) \text{ in the basis},
$$

where p.N = P. The cone of a cell has three components.

**Exact on every mesh.** Under the tractions of a uniform stress S(t) on the whole boundary, stress and strain in the
block are uniform. If S_yy = -S_xx, then S_zz and p_2 are zero, and the load alone determines s = sqrt 2 (S_xx, 0, S_xy)
in the basis. Each step is the *return mapping*

$$ P_n = P_{n-1} + (1 - R / |z|)_+ z / H, \qquad z = s_n - H P_{n-1}. $$

Let play_R(x) stay within R of x, and change only if it must. Under shear alone, S_xy = tau, the return mapping is
p_3 = play_R(sqrt 2 tau) / H. The shear strain gamma = tau / mu + sqrt 2 p_3 has no error in time if tau is monotone
between instants. If the direction of s changes, backward Euler makes an error.

    python problems/elastoplastic_block.py --picture elastoplastic_block.png
"""

import argparse
import time
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

import vemcvx as vx
from spring_slider_chain import sample
from vemcvx.vem import Space, stiffness, strains, stress_load

YOUNG, POISSON, HARDENING, YIELD = 200.0, 0.3, 30.0, 1.0
MU = YOUNG / (2 * (1 + POISSON))
LAM = 2 * MU * POISSON / (1 - 2 * POISSON)
RADIUS = np.sqrt(2 / 3) * YIELD
BASIS = np.array([[1, -1, 0], [1 / np.sqrt(3), 1 / np.sqrt(3), 0], [0, 0, 1]]) / np.sqrt(2)
"""Components xx, yy, xy of N_1, N_2, N_3, one row each."""
SPIRAL = np.linspace(0, 4 * np.pi, 49)


class Block(NamedTuple):
    """A system with the unknowns (u, p), and the indices of the free unknowns in u."""

    system: vx.System
    free: np.ndarray


def block(mesh, stress):
    """Return the block under the tractions of uniform stresses; row n of `stress` is (xx, yy, xy) at t = n."""
    space, n = Space(mesh), mesh.n_cells
    work = stress_load(space)
    elastic = stiffness(space, np.full(n, LAM), np.full(n, MU))
    coupling = work @ sp.kron(sp.identity(n), 2 * MU * BASIS.T)
    volumes = np.repeat(mesh.areas, 3)
    free = np.setdiff1d(np.arange(space.n_unknowns), _support_unknowns(mesh))
    K_up = coupling[free]
    K = sp.bmat([[elastic[free][:, free], -K_up], [-K_up.T, sp.diags((2 * MU + HARDENING) * volumes)]], format="csr")
    # Uniform stresses do the same work as their tractions: sum_K |K| S : eps(v) = int Sn . v.
    tractions = (work @ sp.kron(np.ones((n, 1)), sp.identity(3))).tocsr()[free]

    def load(t):
        return np.concatenate([tractions @ sample(stress)(t), np.zeros(3 * n)])

    B = sp.hstack([sp.csr_matrix((3 * n, len(free))), sp.identity(3 * n)])
    return Block(vx.System(K, load, vx.Norms(B, RADIUS * mesh.areas, block=3)), free)


def _support_unknowns(mesh):
    """Return the indices of three fixed unknowns: u of the lower left corner, u_y of the lower right corner."""
    corner = np.argmin(mesh.points.sum(axis=1))
    other = np.argmax(mesh.points[:, 0] - mesh.points[:, 1])
    return [2 * corner, 2 * corner + 1, 2 * other + 1]


def spiral():
    """Return stresses with S_yy = -S_xx, whose deviator grows and makes two turns."""
    size = 2.5 * RADIUS * SPIRAL / SPIRAL[-1]
    x, xy = size * np.cos(SPIRAL) / np.sqrt(2), size * np.sin(SPIRAL) / np.sqrt(2)
    return np.column_stack([x, -x, xy])


def exact_solution(stress):
    """Return plastic strains in the basis, strains (xx, yy, 2 xy), and s - H P in the basis, one row per instant."""
    s = np.sqrt(2) * np.column_stack([stress[:, 0], 0 * stress[:, 0], stress[:, 2]])
    p = np.zeros_like(s)
    for n in range(1, len(s)):
        q = s[n] - HARDENING * p[n - 1]
        size = max(np.linalg.norm(q), RADIUS)
        p[n] = p[n - 1] + (1 - RADIUS / size) * q / HARDENING
    total = (s / (2 * MU) + p) @ BASIS
    return p, total * [1, 1, 2], s - HARDENING * p


def cell_strains(mesh, posed, trajectory):
    """Return plastic strains and strains: arrays of shape (instants, cells, 3)."""
    u = np.zeros((len(trajectory.state), 2 * mesh.n_nodes))
    u[:, posed.free] = trajectory.state[:, : len(posed.free)]
    plastic = trajectory.state[:, len(posed.free) :].reshape(len(u), -1, 3)
    return plastic, np.array([strains(Space(mesh), row) for row in u])


def picture(path, stress, p):
    """Draw the paths of the stress s and of the centre H P of the yield surface, in the plane of deviators."""
    from vemcvx.base.canvas import new_figure
    from vemcvx.plots.style import SERIES

    figure = new_figure(5.6, 5.9)
    ax = figure.add_subplot()
    s = np.sqrt(2) * stress[:, [0, 2]]
    ax.plot(*s.T, "o-", color=SERIES[0], linewidth=1, markersize=3, label="stress s")
    ax.plot(*HARDENING * p[:, [0, 2]].T, "^-", color=SERIES[1], linewidth=1, markersize=4, label="centre H P")
    angle = np.linspace(0, 2 * np.pi, 201)
    for n, style in ((0, ":"), (24, "--"), (48, "-.")):
        centre = HARDENING * p[n, [0, 2], None]
        circle = centre + RADIUS * np.array([np.cos(angle), np.sin(angle)])
        ax.plot(*circle, style, color="0.35", linewidth=1.1, label=f"yield surface, step {n}")
        ax.plot(*s[n], "ks", fillstyle="none", markersize=7, label=None if n else "stress at these steps")
    ax.set(xlabel="component of diag(1, -1, 0)", ylabel="component of shear")
    ax.set_title("the yield surface, a circle about its centre, follows the stress", fontsize="medium")
    ax.set_aspect("equal")
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize="small")
    figure.savefig(path, dpi=120)


def main(path=None):
    mesh, stress = vx.meshes.voronoi(4), spiral()
    p, _, back = exact_solution(stress)
    posed = block(mesh, stress)
    print(f"von Mises block of {mesh.n_cells} polygons, a cone of three components each")
    print("solver      error of P   certified   error of lam   dissipated     seconds")
    for solver in (vx.Newton(), vx.Clarabel()):
        start = time.perf_counter()
        trajectory = vx.march(posed.system, np.arange(float(len(stress))), solver=solver)
        seconds = time.perf_counter() - start
        plastic, _ = cell_strains(mesh, posed, trajectory)
        density = trajectory.multipliers / mesh.areas[:, None]
        print(
            f"{solver.name:9s}{np.abs(plastic - p[:, None]).max():12.1e}{trajectory.certificate_total[-1]:12.1e}"
            f"{np.abs(density - back[:, None]).max():15.1e}{trajectory.dissipated[-1]:15.10f}{seconds:10.2f}"
        )
    lost = RADIUS * np.linalg.norm(np.diff(p, axis=0), axis=1).sum()
    print(f"in closed form: dissipated {lost:.10f}")
    if path:
        picture(path, stress, p)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", metavar="FILE")
    main(parser.parse_args().picture)
