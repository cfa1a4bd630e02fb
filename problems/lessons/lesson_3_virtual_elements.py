# %% [markdown]
"""# Lesson 3, virtual elements from scratch: projection, stabilisation, patch test, locking"""

# %% [markdown]
# Virtual elements are finite elements whose cells are any polygons. Their functions are known on the boundary of a cell
# only (hence *virtual*), and that is enough: all that the method needs of them follows exactly from their vertex
# values. We build the stiffness matrix of one pentagon by hand, compare it with the package's to the last digits, pass
# the patch test, and see why the second half of the construction decides about nearly incompressible materials.
#
# Equation numbers are those of Feng, Han and Huang; you know P1 finite elements.

# %%
import numpy as np
import scipy.sparse as sp
from matplotlib.collections import PolyCollection
from scipy.sparse.linalg import spsolve

import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots.style import COMPUTED, EXACT, OUTLINE, SECOND, THIRD

# %% [markdown]
# ## 1. The functions nobody computes
#
# On a polygon $K$ with vertices $x_1, \dots, x_n$ the space (3.11) has the fields $v$ whose components are harmonic
# inside and linear on every edge. A field is given by its $2n$ vertex values, linear fields are among them, and two
# cells with a common edge fit together. But inside the cell we do not know $v$.
#
# What can we know? By Gauss' theorem, the *mean over the cell* of a derivative is an integral over the boundary, where
# $v$ is linear on each edge. With $N_i = \tfrac12(|e_{i-1}| n_{i-1} + |e_i| n_i)$, half the sum of the outward normals
# of the two edges at $x_i$, each as long as its edge,
#
# $$\int_K \nabla v \,dx = \int_{\partial K} v \otimes n \,ds = \sum_i v_i \otimes N_i .$$
#
# So mean strains, the mean rotation and the mean over the boundary are linear functionals of the vertex values. These
# are the conditions by which the paper defines the *projection* $\Pi v$, a linear field, six numbers:
#
# $$\int_K \varepsilon(\Pi v) : \varepsilon(q) = \int_K \varepsilon(v) : \varepsilon(q) \;\; \forall \text{ linear } q,
#   \qquad \int_{\partial K} \Pi v = \int_{\partial K} v, \qquad \int_K \nabla \times \Pi v = \int_K \nabla \times v.$$
#
# Six functionals, as a matrix $F$ of six rows that act on vertex values $(v_{1x}, v_{1y}, v_{2x}, \dots)$:


# %%
def vertex_normals(x):
    """N_i: the edge from x_i to x_(i+1), turned by -90 degrees, is its outward normal times its length."""
    edges = np.roll(x, -1, axis=0) - x
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])
    return 0.5 * (normals + np.roll(normals, 1, axis=0))


def functionals(x):
    N, zero = vertex_normals(x), np.zeros(len(x))
    length = np.linalg.norm(np.roll(x, -1, axis=0) - x, axis=1)
    w = 0.5 * (length + np.roll(length, 1)) / length.sum()
    rows = [  # of every vertex, what multiplies v_x and what multiplies v_y
        (N[:, 0], zero),  # integral of e_xx
        (zero, N[:, 1]),  # integral of e_yy
        (N[:, 1], N[:, 0]),  # integral of 2 e_xy
        (w, zero),  # mean over the boundary, x
        (zero, w),  # and y
        (-N[:, 1], N[:, 0]),  # integral of the rotation, d v_y / dx - d v_x / dy
    ]
    return np.array([np.column_stack(row).ravel() for row in rows])


# %% [markdown]
# Linear fields are combinations of the translations, the rotation and three of constant strain. Their vertex values are
# the columns of $D$, and then the conditions are six equations: find the coefficients $c$ with $F D c = F v$. So
#
# $$\Pi_* = (FD)^{-1} F \quad (\text{vertex values to coefficients}), \qquad
#   \Pi = D\,\Pi_* \quad (\text{vertex values to vertex values}).$$


# %%
def linear_fields(x):
    """Vertex values of (x,0), (0,y), (y,x)/2, (1,0), (0,1), (-y,x)/2: strains e_xx, e_yy, 2 e_xy of one, motions."""
    X, Y = x.T
    zero, one = np.zeros(len(x)), np.ones(len(x))
    fields = [(X, zero), (zero, Y), (Y / 2, X / 2), (one, zero), (zero, one), (-Y / 2, X / 2)]
    return np.column_stack([np.column_stack(field).ravel() for field in fields])


def projections(x):
    F, D = functionals(x), linear_fields(x)
    to_coefficients = np.linalg.solve(F @ D, F)
    return to_coefficients, D @ to_coefficients


pentagon = np.array([[0.0, 0.0], [1.0, -0.1], [1.3, 0.6], [0.6, 1.2], [-0.2, 0.7]])
to_coefficients, Pi = projections(pentagon)

# %% [markdown]
# Is $\Pi$ a projection? Then it leaves linear fields unchanged, and $\Pi\,\Pi = \Pi$. Matrices of six or ten rows with
# entries of size one round to about 1e-15; 1e-13 is granted, here and for all matrices of this section.

# %%
assert np.abs(Pi @ linear_fields(pentagon) - linear_fields(pentagon)).max() < 1e-13
assert np.abs(Pi @ Pi - Pi).max() < 1e-13
assert np.linalg.matrix_rank(Pi) == 6
print(f"a projection of rank 6, on the {len(Pi)} vertex values of a pentagon")

# %% [markdown]
# ## 2. The stiffness: what is consistent, and what is stable
#
# With the strain of $\Pi v$ in place of the strain of $v$, the energy of a cell is computable; (3.13) is
#
# $$a_K^h(u, v) = |K|\; \varepsilon(\Pi u) : \mathbb C\, \varepsilon(\Pi v) + S_K(u - \Pi u,\; v - \Pi v).$$
#
# The first term is exact as soon as one of the two fields is linear (*consistency*, (2.8)). But it has rank 3, and a
# pentagon has ten unknowns, three of them rigid motions: four deformations would cost nothing (*hourglass modes*). They
# are just what $\Pi$ misses, $v - \Pi v$, and the second term gives them an energy. It need not be their true energy,
# only of the same size (*stability*, (2.9)). In vertex values,
#
# $$S_K = \tau\,(I - \Pi)^T (I - \Pi), \qquad \tau = 2\mu .$$
#
# (The paper's text has $\tau = 1$, a number that does not know the unit of stress; `Elasticity(stabilisation="unit")`.)


# %%
def lame(young, poisson):
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


def cell_stiffness(x, lam, mu, tau=None):
    to_linear, projected = projections(x)
    size = np.sum(vertex_normals(x)[:, 0] * x[:, 0])
    C = np.array([[lam + 2 * mu, lam, 0], [lam, lam + 2 * mu, 0], [0, 0, mu]])
    strain = to_linear[:3]
    missed = np.eye(2 * len(x)) - projected
    return size * strain.T @ C @ strain + (2 * mu if tau is None else tau) * missed.T @ missed


moduli = lame(1.0, 0.3)
by_hand = cell_stiffness(pentagon, *moduli)
one_cell = vx.PolygonMesh(pentagon, [np.arange(5)])
package = vx.vem.stiffness(vx.vem.Space(one_cell), *(np.array([value]) for value in moduli)).toarray()
apart = np.abs(by_hand - package).max() / np.abs(package).max()
assert apart < 1e-13
print(f"by hand and by the package: {apart:.1e} apart")

# %% [markdown]
# Count the eigenvalues that are zero: three with the stabilisation, for the rigid motions, and seven without.
# Eigenvalues below 1e-13 of the largest count as zero, as above; the smallest of the others is a third of the largest.


# %%
def free_modes(K):
    values = np.linalg.eigvalsh(K)
    return int(np.sum(values < 1e-13 * values.max()))


assert free_modes(by_hand) == 3
assert free_modes(cell_stiffness(pentagon, *moduli, tau=0.0)) == 7

# %% [markdown]
# On a square the modes come apart cleanly: three rigid motions (not drawn), three of constant strain, and two that
# $\Pi$ misses altogether, the hourglasses. (Drawn with $\tau = \mu$: at $2\mu$ an hourglass costs exactly what a shear
# does, and the eigenvectors mix.) **Question:** which of the two terms of $a_K^h$ pays for each, and how do you see it
# by turning $\tau$ up?
#
# <details><summary>Answer</summary>
#
# The first term pays for the strains: they are linear fields, $\Pi v = v$, so $S_K$ is zero on them. The second pays
# for the hourglasses: the mean of their strain is zero, so the first term is zero on them, and $S_K(v, v) = \tau
# |v|^2$. Turn $\tau$ up, and the two eigenvalues of the hourglasses grow in proportion, they are $\tau$ itself, while
# the three of the strains stay at $2\mu$, $2\mu$ and $2(\lambda + \mu)$.
#
# </details>

# %%
square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
values, vectors = np.linalg.eigh(cell_stiffness(square, *moduli, tau=moduli[1]))
missed_share = np.linalg.norm(vectors - projections(square)[1] @ vectors, axis=0) ** 2
assert np.allclose(np.sort(missed_share), [0, 0, 0, 0, 0, 0, 1, 1], atol=1e-13)


# %% jupyter={"source_hidden": true}
def modes():
    figure = new_figure(7.6, 2.3)
    for axes, k in zip(figure.subplots(1, 5), range(3, 8), strict=True):
        moved = square + 0.35 * vectors[:, k].reshape(-1, 2)
        colour = SECOND if missed_share[k] > 0.5 else COMPUTED
        axes.add_collection(PolyCollection([square], facecolor="none", edgecolor=OUTLINE, linestyle="--"))
        axes.add_collection(PolyCollection([moved], facecolor="0.93", edgecolor=colour, linewidth=1.5))
        kind = "missed" if missed_share[k] > 0.5 else "strain"
        axes.set(xlim=(-0.3, 1.3), ylim=(-0.3, 1.3), aspect="equal", title=f"{kind}: {values[k]:.2f}")
        axes.set_axis_off()
    figure.suptitle("modes of the unit square, with their eigenvalues")
    return figure


modes()

# %% [markdown]
# ## 3. Many cells: the patch test
#
# Assembly is that of finite elements. The *patch test*: prescribe a linear field on the boundary of a mesh, and nothing
# inside; then it must come out linear inside, on every mesh, exactly. It tests the whole of section 1 (consistency) and
# would fail for a wrong normal, weight or rotation.


# %%
def assemble(mesh, lam, mu, tau=None):
    rows, columns, values = [], [], []
    for nodes in mesh.cells:
        unknowns = np.column_stack([2 * nodes, 2 * nodes + 1]).ravel()
        rows.append(np.repeat(unknowns, len(unknowns)))
        columns.append(np.tile(unknowns, len(unknowns)))
        values.append(cell_stiffness(mesh.points[nodes] - mesh.points[nodes[0]], lam, mu, tau).ravel())
    size = 2 * mesh.n_nodes
    triples = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sp.coo_matrix(triples, shape=(size, size)).tocsr()


def patch_test(mesh):
    """The largest error, and what rounding may leave: the condition number of the system times 1e-16."""
    K = assemble(mesh, *moduli)
    linear = (mesh.points @ np.array([[1.0, 0.3], [-0.2, 0.5]]) + 0.1).ravel()
    held = np.unique(mesh.boundaries["boundary"])
    inside = np.setdiff1d(np.arange(mesh.n_nodes), held)
    free, given = (np.column_stack([2 * n, 2 * n + 1]).ravel() for n in (inside, held))
    u = spsolve(K[free][:, free].tocsc(), -K[free][:, given] @ linear[given])
    return np.abs(u - linear[free]).max(), np.linalg.cond(K[free][:, free].toarray()) * np.finfo(float).eps


for _family in ("squares", "triangles", "voronoi", "distorted", "hanging", "nonconvex"):
    _error, _rounding = patch_test(vx.meshes.FAMILIES[_family](5))
    assert _error <= _rounding
    print(f"{_family:10} error {_error:.0e}, rounding may leave {_rounding:.0e}")

# %% [markdown]
# ## 4. Locking
#
# A cantilever, four long and one high, clamped on the left, sheared down by the force 1 on the right. Its compliance
# $c = f \cdot u$ is the deflection of the end. For rubber, $\nu \to \tfrac12$, and $\lambda \to \infty$: changes of
# area cost more and more, in the limit they are forbidden. A mesh *locks* if that forbids what the body should do.
#
# With P1 triangles, $\mathrm{div}\, u = 0$ is one condition a triangle, that is two a node: as many as unknowns. On
# squares it is one a node, half as many. In (3.13), $\lambda$ multiplies the mean of the divergence alone, once a cell,
# whatever the number of its vertices, and a stabilisation in $\mu$ leaves that so.


# %%
def end_load(mesh):
    f = np.zeros((mesh.n_nodes, 2))
    edges = mesh.boundaries["right"]
    length = np.linalg.norm(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]], axis=1)
    np.add.at(f[:, 1], edges, -0.5 * length[:, None])
    return f.ravel()


def compliances(mesh, poissons):
    """The matrix is linear in lambda and mu, tau = 2 mu included: two assemblies serve all of them."""
    of_lam, of_mu, f = assemble(mesh, 1.0, 0.0), assemble(mesh, 0.0, 1.0), end_load(mesh)
    clamped = np.unique(mesh.boundaries["left"])
    free = np.setdiff1d(np.arange(len(f)), np.concatenate([2 * clamped, 2 * clamped + 1]))
    found = []
    for lam, mu in map(lame, np.ones(len(poissons)), poissons):
        K = (lam * of_lam + mu * of_mu)[free][:, free].tocsc()
        found.append(f[free] @ spsolve(K, f[free]))
    return np.array(found)


poissons = 0.5 - 10.0 ** -np.array([0.7, 1, 2, 3, 4, 6])
cantilever = {
    (family, n): compliances(vx.meshes.FAMILIES[family](n, box=((0, 4), (0, 1))), poissons)
    for family in ("squares", "hexagons", "triangles")
    for n in (4, 8)
}

# %% [markdown]
# What should we see? Timoshenko's beam, $EI' = E/(12(1 - \nu^2))$, deflects by $L^3/(3EI') + 1.2\,L/\mu$ (force and
# height are 1), which is 206 at $\nu = \tfrac12$; the clamp makes the end of it a little stiffer.
#
# And what can a body do that *cannot* bend? Vertical motions $u = (0, v(x))$ have no divergence at all and are in every
# space, so shear survives: at least $L/\mu = 12$. Locked triangles have that, and hardly more: on both meshes less than
# a tenth of 206, and the finer one is no better. Squares and hexagons lose less than a quarter on the coarse mesh, and
# refinement divides what they lose by two or more (the error in $c$ is that of the energy *squared*).

# %%
beam = 4.0**3 / 3 * 12 * (1 - poissons**2) + 1.2 * 4 * 2 * (1 + poissons)
limit = compliances(vx.meshes.squares(16, box=((0, 4), (0, 1))), poissons[-1:])[0]
for _family in ("squares", "hexagons"):
    _lost = [limit - cantilever[_family, n][-1] for n in (4, 8)]
    assert _lost[1] < 0.5 * _lost[0] < 0.125 * limit
for _n in (4, 8):
    assert 4 / lame(1.0, poissons[-1])[1] < cantilever["triangles", _n][-1] < 0.1 * beam[-1]
print(f"beam {beam[-1]:.0f}, fine squares {limit:.0f};", {key: round(c[-1]) for key, c in cantilever.items()})


# %% jupyter={"source_hidden": true}
def locking(results):
    figure = new_figure(6.6, 3.9)
    axes = figure.add_subplot()
    axes.semilogx(0.5 - poissons, beam, color=EXACT, linewidth=1.0, label="Timoshenko's beam")
    marks = {"squares": ("s", COMPUTED), "hexagons": ("h", THIRD), "triangles": ("^", SECOND)}
    for (family, n), c in results.items():
        mark, colour = marks[family]
        style = {"linestyle": "--" if n == 4 else "-", "fillstyle": "none" if n == 4 else "full"}
        axes.semilogx(0.5 - poissons, c, marker=mark, color=colour, label=f"{family}, {n} across", **style)
    axes.invert_xaxis()
    axes.set(xlabel=r"$\frac{1}{2} - \nu$: rubber is to the right", ylabel="deflection of the end", ylim=(0, None))
    axes.set_title("triangles lock, squares and hexagons do not")
    light_grid(axes)
    axes.legend(frameon=False, fontsize="small", ncols=2)
    return figure


locking(cantilever)

# %% [markdown]
# **Question:** the triangles are not "a bit stiff": which two numbers of the picture say that refining them by two
# changes nothing at $\nu \to \tfrac12$, and why is the stabilisation not to blame?
#
# <details><summary>Answer</summary>
#
# The right ends of the two curves of triangles: the deflection is 14.63 with 4 cells across and 14.66 with 8, where the
# body has 206. On a triangle three vertices determine a linear field, so $\Pi v = v$ and $S_K = 0$ (exercise 1):
# whatever $\tau$ is, it multiplies zero. What locks is the first term, which forbids changes of area in every triangle,
# two conditions a node.
#
# </details>
#
# ## Exercises
#
# 1. Show that on a triangle $\Pi v = v$ for all $v$, and so $S_K = 0$. What is the method then?
# 2. Take $\tau$ = the mean of the diagonal of $\mathbb C$, which grows with $\lambda$ (a popular recipe). What does the
#    cantilever of squares do for $\nu \to \tfrac12$?
# 3. Insert a vertex in the middle of an edge of the unit square (a *hanging node*). How many modes does $\Pi$ miss
#    now? Does the patch test notice? (`hanging` above is such a mesh.)
# 4. $G_i = N_i/|K|$ gives $\nabla \Pi v = \sum_i v_i \otimes G_i$ without solving any equations. Check this against
#    `projections`. Which of the six conditions did you use?
# 5. Multiply all moduli by $10^6$ (MPa to Pa). What happens to $u$ under $10^6$ times the load with $\tau = 2\mu$, and
#    what with $\tau = 1$?
#
# Solutions: `lesson_3_solutions.py`.
