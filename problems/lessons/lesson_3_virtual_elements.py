# %% [markdown]
"""# Lesson 3, virtual elements from scratch: projection, stabilisation, patch test, locking"""

# %% [markdown]
# *You need:* P1 finite elements, Gauss' theorem, linear elasticity. *You will see:* the stiffness matrix of a pentagon,
# by hand and by the package; the patch test; and why nearly incompressible bodies lock on some meshes.
#
# Virtual elements are finite elements whose cells may be any polygons. The functions of a cell are *virtual*: we know
# them on the boundary of the cell only. The method needs a few averages of each function, and the vertex values
# determine these averages exactly.
#
# Equation numbers refer to the paper of Feng, Han and Huang. The paper calls a cell $K$. Here a cell is $\omega$, and
# $K$ is a stiffness matrix.

# %%
import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

import vemcvx as vx

# %% [markdown]
# ## 1. Functions that we never evaluate
#
# On a polygon $\omega$ with the vertices $x_1, \dots, x_m$ the space (3.11) contains the fields $v$ whose components
# are harmonic inside and linear on every edge. The $2m$ vertex values determine a field. All linear fields belong to
# the space, and the fields of two cells agree on a common edge. But we do not know $v$ inside the cell.
#
# By Gauss' theorem, the integral of a derivative over the cell is an integral over the boundary. On each edge $v$ is
# linear. Let $n$ be the outward unit normal. Let the edge $e_i$ from $x_i$ to $x_{i+1}$ have the normal $n_i$, and let
# $N_i = \tfrac12(|e_{i-1}| n_{i-1} + |e_i| n_i)$. Then
#
# $$\int_\omega \nabla v \,dx = \int_{\partial \omega} v \otimes n \,ds = \sum_i v_i \otimes N_i .$$
#
# So the mean strain, the mean rotation and the mean value on the boundary are linear functions of the vertex values.
#
# Mean strain, mean rotation and mean boundary value define the *projection* $\Pi v$, the linear field with
#
# $$\begin{gathered} \int_\omega \varepsilon(\Pi v) : \varepsilon(q) = \int_\omega \varepsilon(v) : \varepsilon(q)
#   \;\; \text{for all linear } q, \\ \int_{\partial \omega} \Pi v = \int_{\partial \omega} v,
#   \qquad \int_\omega \nabla \times \Pi v = \int_\omega \nabla \times v. \end{gathered}$$
#
# Here $\varepsilon$ is the strain. These are three conditions on strains, two on mean values and one on the rotation.
# The right-hand sides are linear functions of the vertex values $(v_{1x}, v_{1y}, v_{2x}, \dots)$. The matrix $F$
# contains the coefficients:


# %%
def vertex_normals(x):
    """Return N_i. If the vertices are ordered counterclockwise, an edge turned by -90 degrees is |e_i| n_i."""
    edges = np.roll(x, -1, axis=0) - x
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])
    return 0.5 * (normals + np.roll(normals, 1, axis=0))


def functionals(x):
    N, zero = vertex_normals(x), np.zeros(len(x))
    length = np.linalg.norm(np.roll(x, -1, axis=0) - x, axis=1)
    mean = 0.5 * (length + np.roll(length, 1)) / length.sum()
    rows = [  # for every vertex, the factor of v_x and the factor of v_y
        (N[:, 0], zero),  # integral of e_xx
        (zero, N[:, 1]),  # integral of e_yy
        (N[:, 1], N[:, 0]),  # integral of 2 e_xy
        (mean, zero),  # mean over the boundary, x
        (zero, mean),  # mean over the boundary, y
        (-N[:, 1], N[:, 0]),  # integral of the rotation, d v_y / dx - d v_x / dy
    ]
    return np.array([np.column_stack(row).ravel() for row in rows])


# %% [markdown]
# A matrix $V$ contains the vertex values of a basis of linear fields: two translations, one rotation, three constant
# strains. If $\Pi v$ has the coefficients $p$, the left-hand sides of the conditions are $FVp$. The right-hand sides
# are $Fv$, so
#
# $$\begin{aligned} \Pi_* &= (FV)^{-1} F && (\text{vertex values to coefficients}), \\
#   \Pi &= V\,\Pi_* && (\text{vertex values to vertex values}). \end{aligned}$$


# %%
def linear_fields(x):
    """Return the vertex values of (x,0), (0,y), (y,x)/2 (unit strains) and (1,0), (0,1), (-y,x)/2 (rigid motions)."""
    X, Y = x.T
    zero, one = np.zeros(len(x)), np.ones(len(x))
    fields = [(X, zero), (zero, Y), (Y / 2, X / 2), (one, zero), (zero, one), (-Y / 2, X / 2)]
    return np.column_stack([np.column_stack(field).ravel() for field in fields])


def projections(x):
    F, V = functionals(x), linear_fields(x)
    to_coefficients = np.linalg.solve(F @ V, F)
    return to_coefficients, V @ to_coefficients


pentagon = np.array([[0.0, 0.0], [1.0, -0.1], [1.3, 0.6], [0.6, 1.2], [-0.2, 0.7]])
to_coefficients, Pi = projections(pentagon)

# %% [markdown]
# If $\Pi$ is a projection, $\Pi$ leaves linear fields unchanged, and $\Pi\,\Pi = \Pi$. We allow rounding errors of
# 1e-13.

# %%
assert np.abs(Pi @ linear_fields(pentagon) - linear_fields(pentagon)).max() < 1e-13
assert np.abs(Pi @ Pi - Pi).max() < 1e-13
assert np.linalg.matrix_rank(Pi) == 6
print(f"Pi is a projection of rank 6 on the {len(Pi)} vertex values of a pentagon")

# %% [markdown]
# ## 2. The stiffness: consistency and stability
#
# We cannot compute the strain of $v$ inside a cell, so we use the strain of $\Pi v$ in the energy. With the tensor
# $\mathbb C$ of elasticity, (3.13) is
#
# $$a_\omega^h(u, v) = |\omega|\; \varepsilon(\Pi u) : \mathbb C\, \varepsilon(\Pi v)
#   + S_\omega(u - \Pi u,\; v - \Pi v).$$
#
# The first term is exact if one of the two fields is linear (*consistency*, (2.8)). But the rank of this term is 3. A
# pentagon has ten unknowns, and three independent motions are rigid. So four independent deformations cost no energy:
# the fields with $\Pi v = 0$, called *hourglass modes*.
#
# The second term, the *stabilisation*, gives energy to the remainder $v - \Pi v$. This energy must have the size of the
# exact energy (*stability*, (2.9)). In vertex values,
#
# $$S_\omega = \eta\,(I - \Pi)^T (I - \Pi), \qquad \eta = 2\mu .$$
#
# Here $I$ is the identity, and $\mu$ and $\Lambda$ are Lamé's moduli. The paper has $\eta = 1$. With this $\eta$ the
# answer depends on the unit of stress (exercise 5). In plane strain the stress is
# $\mathbb C \varepsilon = 2\mu\,\varepsilon + \Lambda\,(\mathrm{tr}\, \varepsilon)\, I$.


# %%
def lame(young, poisson):
    """Return Lamé's moduli, Lambda and mu."""
    return young * poisson / ((1 + poisson) * (1 - 2 * poisson)), young / (2 * (1 + poisson))


def cell_stiffness(x, Lambda, mu, eta=None):
    to_linear, projected = projections(x)
    area = np.sum(vertex_normals(x)[:, 0] * x[:, 0])
    C = np.array([[Lambda + 2 * mu, Lambda, 0], [Lambda, Lambda + 2 * mu, 0], [0, 0, mu]])
    strain = to_linear[:3]
    remainder = np.eye(2 * len(x)) - projected
    return area * strain.T @ C @ strain + (2 * mu if eta is None else eta) * remainder.T @ remainder


moduli = lame(1.0, 0.3)
by_hand = cell_stiffness(pentagon, *moduli)
one_cell = vx.PolygonMesh(pentagon, [np.arange(5)])
package = vx.vem.stiffness(vx.vem.Space(one_cell), *(np.array([value]) for value in moduli)).toarray()
apart = np.abs(by_hand - package).max() / np.abs(package).max()
assert apart < 1e-13
print(f"the matrices by hand and by the package differ by {apart:.1e}")

# %% [markdown]
# With the stabilisation three eigenvalues are zero, for the three rigid motions. Without the stabilisation seven
# eigenvalues are zero. We count an eigenvalue as zero if it is below 1e-13 times the largest eigenvalue.


# %%
def free_modes(K):
    """Return the number of zero eigenvalues."""
    values = np.linalg.eigvalsh(K)
    return int(np.sum(values < 1e-13 * values.max()))


assert free_modes(by_hand) == 3
assert free_modes(cell_stiffness(pentagon, *moduli, eta=0.0)) == 7

# %% [markdown]
# A square has three rigid motions (not drawn), three modes of constant strain, and two hourglass modes with
# $\Pi v = 0$. In the picture $\eta = \mu$. **Question:** which of the two terms of $a_\omega^h$ gives each mode its
# energy? What happens to the eigenvalues if you increase $\eta$?
#
# <details><summary>Answer</summary>
#
# The first term gives the energy of the modes of strain. These modes are linear fields, so $\Pi v = v$ and the second
# term is zero. The second term gives the energy of the hourglass modes: their mean strain is zero, so the first term is
# zero, and $S_\omega(v, v) = \eta |v|^2$. The eigenvalues of both hourglass modes are $\eta$, so they increase with
# $\eta$. The eigenvalues of the three strains stay at $2\mu$, $2\mu$ and $2(\Lambda + \mu)$.
#
# </details>


# %%
square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
values, vectors = np.linalg.eigh(cell_stiffness(square, *moduli, eta=moduli[1]))
remainder = np.linalg.norm(vectors - projections(square)[1] @ vectors, axis=0) ** 2
assert np.allclose(np.sort(remainder), [0, 0, 0, 0, 0, 0, 1, 1], atol=1e-13)


# %% jupyter={"source_hidden": true}
# Picture: three modes of constant strain and two hourglass modes of the unit square, with their eigenvalues
def modes():
    figure, panels = plt.subplots(1, 5, figsize=(7.6, 2.3), layout="constrained")
    for axes, k in zip(panels, range(3, 8), strict=True):
        moved = square + 0.35 * vectors[:, k].reshape(-1, 2)
        kind, colour = ("hourglass", "tab:orange") if remainder[k] > 0.5 else ("strain", "tab:blue")
        axes.fill(*square.T, facecolor="none", edgecolor="0.4", linestyle="--")
        axes.fill(*moved.T, facecolor="0.93", edgecolor=colour, linewidth=1.5, alpha=0.8)
        axes.set(xlim=(-0.3, 1.3), ylim=(-0.3, 1.3), aspect="equal")
        axes.set_title(f"{kind}: {values[k]:.2f}", fontsize="medium")
        axes.set_axis_off()
    figure.suptitle("modes of the unit square, with their eigenvalues")
    plt.close(figure)
    return figure


modes()

# %% [markdown]
# ## 3. Many cells: the patch test
#
# The cells are assembled like finite elements. The *patch test* prescribes a linear field on the boundary of a mesh,
# without any load inside. On every mesh, the solution must be this field, up to rounding. With a matrix $A$ and a
# vector $b$:
#
# $$u = Ax + b \text{ on the boundary} \quad\Rightarrow\quad u = Ax + b \text{ at all vertices.}$$
#
# The patch test checks consistency. It does not check the stabilisation, because $v - \Pi v$ vanishes for linear $v$.


# %%
def assemble(mesh, Lambda, mu, eta=None):
    rows, columns, values = [], [], []
    for nodes in mesh.cells:
        unknowns = np.column_stack([2 * nodes, 2 * nodes + 1]).ravel()
        rows.append(np.repeat(unknowns, len(unknowns)))
        columns.append(np.tile(unknowns, len(unknowns)))
        values.append(cell_stiffness(mesh.points[nodes] - mesh.points[nodes[0]], Lambda, mu, eta).ravel())
    size = 2 * mesh.n_nodes
    triples = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sp.coo_matrix(triples, shape=(size, size)).tocsr()


def patch_test(mesh):
    """Return the largest error, and the error that rounding may cause: the condition number times 2e-16."""
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
    print(f"{_family:10} error {_error:.0e}, allowed for rounding {_rounding:.0e}")

# %% [markdown]
# ## 4. Locking
#
# A cantilever, four long and one high, is clamped on the left. A downward force of 1 acts on its right end. With the
# vector $f$ of nodal loads, the mean deflection of the end is $f^T u$.
#
# For rubber, Poisson's ratio $\nu$ tends to $\tfrac12$, and $\Lambda$ tends to infinity. Changes of area cost more and
# more energy. In the limit
#
# $$\mathrm{div}\, u = 0 .$$
#
# A mesh *locks* if this constraint prevents deformations that the body can perform. Every cell has one condition,
# because $\Lambda$ multiplies only the mean divergence of the cell. Every node has two unknowns. A mesh of triangles
# has about two triangles per node, and thus as many conditions as unknowns. A mesh of squares has about one square per
# node, and thus half as many conditions as unknowns. A stabilisation with $\eta = 2\mu$ adds no condition.


# %%
def end_load(mesh):
    f = np.zeros((mesh.n_nodes, 2))
    edges = mesh.boundaries["right"]
    length = np.linalg.norm(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]], axis=1)
    np.add.at(f[:, 1], edges, -0.5 * length[:, None])
    return f.ravel()


def deflections(mesh, poissons):
    """Return f^T u for each Poisson's ratio; K is linear in Lambda and mu."""
    K_Lambda, K_mu, f = assemble(mesh, 1.0, 0.0), assemble(mesh, 0.0, 1.0), end_load(mesh)
    clamped = np.unique(mesh.boundaries["left"])
    free = np.setdiff1d(np.arange(len(f)), np.concatenate([2 * clamped, 2 * clamped + 1]))
    found = []
    for Lambda, mu in map(lame, np.ones(len(poissons)), poissons):
        K = (Lambda * K_Lambda + mu * K_mu)[free][:, free].tocsc()
        found.append(f[free] @ spsolve(K, f[free]))
    return np.array(found)


poissons = 0.5 - 10.0 ** -np.array([0.7, 1, 2, 3, 4, 6])
cantilever = {
    (family, n): deflections(vx.meshes.FAMILIES[family](n, box=((0, 4), (0, 1))), poissons)
    for family in ("squares", "hexagons", "triangles")
    for n in (4, 8)
}

# %% [markdown]
# Which deflection do we expect? Let $E$ be Young's modulus, and $E' = E/(1 - \nu^2)$. Timoshenko's beam of the length 4
# and the height 1 deflects by
#
# $$\frac{12 \cdot 4^3}{3 E'} + \frac{1.2 \cdot 4}{\mu},$$
#
# which is 206 at $\nu = \tfrac12$ and $E = 1$. The clamp makes the body a little stiffer.
#
# How much does a body deflect if it *cannot* bend? The shear $u = (0, -x)$ has no divergence, and every mesh can
# represent this field. So shear remains, with a deflection of at least $4/\mu = 12$. The triangles deflect by less than
# a tenth of 206 on both meshes: they lock. On coarse squares and hexagons the deflection is too small by less than a
# quarter, and refinement at least halves this error.

# %%
beam = 12 * 4.0**3 / 3 * (1 - poissons**2) + 1.2 * 4 * 2 * (1 + poissons)
limit = deflections(vx.meshes.squares(16, box=((0, 4), (0, 1))), poissons[-1:])[0]
for _family in ("squares", "hexagons"):
    _lost = [limit - cantilever[_family, n][-1] for n in (4, 8)]
    assert _lost[1] < 0.5 * _lost[0] < 0.125 * limit
for _n in (4, 8):
    assert 4 / lame(1.0, poissons[-1])[1] < cantilever["triangles", _n][-1] < 0.1 * beam[-1]
coarse = {key: round(values[-1]) for key, values in cantilever.items()}
print(f"deflections: beam {beam[-1]:.0f}, fine squares {limit:.0f}; (family, cells across): {coarse}")


# %% jupyter={"source_hidden": true}
# Picture: deflection over Poisson's ratio; for triangles it falls to a tenth, squares and hexagons follow the beam
def locking(results):
    figure, axes = plt.subplots(figsize=(6.6, 3.9), layout="constrained")
    axes.semilogx(0.5 - poissons, beam, color="black", linewidth=1.0, label="Timoshenko's beam")
    marks = {"squares": ("s", "tab:blue"), "hexagons": ("h", "tab:green"), "triangles": ("^", "tab:orange")}
    for (family, n), deflection in results.items():
        mark, colour = marks[family]
        style = {"linestyle": "--" if n == 4 else "-", "fillstyle": "none" if n == 4 else "full"}
        axes.semilogx(0.5 - poissons, deflection, mark, color=colour, label=f"{family}, {n} cells across", **style)
    axes.invert_xaxis()
    axes.set(xlabel=r"$\frac{1}{2} - \nu$ (rubber: right)", ylabel="deflection of the end", ylim=(0, None))
    axes.set_title("triangles lock, squares and hexagons do not")
    axes.grid(color="0.9")
    axes.legend(frameon=False, fontsize="small", ncols=2)
    plt.close(figure)
    return figure


locking(cantilever)

# %% [markdown]
# **Question:** where does the picture show that refinement does not help triangles for $\nu \to \tfrac12$? And why is
# the stabilisation not the cause?
#
# <details><summary>Answer</summary>
#
# The two curves of triangles end at the same height: the deflection is 14.63 with 4 cells across and 14.66 with 8. The
# beam deflects by 206. On a triangle three vertices determine a linear field, so $\Pi v = v$ and $S_\omega = 0$
# (exercise 1). The first term of $a_\omega^h$ is the cause. It forbids changes of area in every triangle, and these are
# two conditions per node.
#
# </details>
#
# ## Exercises
#
# 1. Show that on a triangle $\Pi v = v$ for all $v$, and so $S_\omega = 0$. Which method is this?
# 2. Let $\eta$ be the mean of the diagonal of $\mathbb C$. This $\eta$ grows with $\Lambda$. How does the cantilever of
#    squares behave for $\nu \to \tfrac12$?
# 3. Insert a vertex in the middle of an edge of the unit square (a *hanging node*). How many independent modes with
#    $\Pi v = 0$ does the cell have now? Does the patch test still hold?
# 4. Compare the formula $\nabla \Pi v = \sum_i v_i \otimes N_i/|\omega|$ with the result of `projections`. Which of the
#    conditions on $\Pi v$ does the formula use?
# 5. Multiply all moduli and the load by $10^6$ (MPa to Pa). How does $u$ change with $\eta = 2\mu$, and how with
#    $\eta = 1$?
#
# Solutions: `lesson_3_solutions.py`.
