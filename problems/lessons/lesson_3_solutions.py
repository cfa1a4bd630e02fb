# %% [markdown]
"""# Solutions to the exercises of lesson 3, virtual elements from scratch"""

# %% [markdown]
# We repeat the matrices of the lesson.

# %%
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

import vemcvx as vx


def vertex_normals(x):
    edges = np.roll(x, -1, axis=0) - x
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])
    return 0.5 * (normals + np.roll(normals, 1, axis=0))


def projection(x):
    """Return the matrices that map v to the strains (3, 2m) and the vertex values (2m, 2m) of Pi v."""
    N, (X, Y), zero, one = vertex_normals(x), x.T, np.zeros(len(x)), np.ones(len(x))
    length = np.linalg.norm(np.roll(x, -1, axis=0) - x, axis=1)
    mean = 0.5 * (length + np.roll(length, 1)) / length.sum()
    rows = [(N[:, 0], zero), (zero, N[:, 1]), (N[:, 1], N[:, 0]), (mean, zero), (zero, mean), (-N[:, 1], N[:, 0])]
    fields = [(X, zero), (zero, Y), (Y / 2, X / 2), (one, zero), (zero, one), (-Y / 2, X / 2)]
    F = np.array([np.column_stack(row).ravel() for row in rows])
    V = np.column_stack([np.column_stack(field).ravel() for field in fields])
    coefficients = np.linalg.solve(F @ V, F)
    return coefficients[:3], V @ coefficients


def cell_stiffness(x, Lambda, mu, eta):
    strain, projected = projection(x)
    C = np.array([[Lambda + 2 * mu, Lambda, 0], [Lambda, Lambda + 2 * mu, 0], [0, 0, mu]])
    remainder = np.eye(2 * len(x)) - projected
    return np.sum(vertex_normals(x)[:, 0] * x[:, 0]) * strain.T @ C @ strain + eta * remainder.T @ remainder


# %% [markdown]
# **1.** On a triangle, one linear field has the six vertex values of $v$. This field is harmonic, and linear on every
# edge. Vertex values determine a field with these two properties. Hence $v$ is the linear field, and $\Pi v = v$. The
# method is P1 finite elements. We allow 1e-13 for rounding, as in the lesson.

# %%
triangle = np.array([[0.0, 0.0], [2.0, 0.3], [0.4, 1.1]])
assert np.abs(projection(triangle)[1] - np.eye(6)).max() < 1e-13

# %% [markdown]
# **2.** The cantilever locks. Squares bend by hourglass modes, and these modes now cost as much energy as changes of
# area. Only the deflection by shear remains, a little more than $4/\mu = 12$. With $\eta = 2\mu$ the same mesh deflects
# by 186, and a fine mesh by 197.


# %%
def deflection(mesh, Lambda, mu, eta):
    K, f = np.zeros((2 * mesh.n_nodes, 2 * mesh.n_nodes)), np.zeros((mesh.n_nodes, 2))
    for nodes in mesh.cells:
        unknowns = np.column_stack([2 * nodes, 2 * nodes + 1]).ravel()
        K[np.ix_(unknowns, unknowns)] += cell_stiffness(mesh.points[nodes], Lambda, mu, eta)
    edges = mesh.boundaries["right"]
    length = np.linalg.norm(mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]], axis=1)
    np.add.at(f[:, 1], edges, -0.5 * length[:, None])
    clamped = np.unique(mesh.boundaries["left"])
    free = np.setdiff1d(np.arange(f.size), np.concatenate([2 * clamped, 2 * clamped + 1]))
    u = spsolve(sp.csc_matrix(K[np.ix_(free, free)]), f.ravel()[free])
    return f.ravel()[free] @ u


def lame(nu):
    """Return Lamé's moduli, Lambda and mu, for Young's modulus 1."""
    return nu / ((1 + nu) * (1 - 2 * nu)), 1 / (2 * (1 + nu))


Lambda, mu = lame(0.5 - 1e-6)
bar = vx.meshes.squares(4, box=((0, 4), (0, 1)))
growing = (2 * (Lambda + 2 * mu) + mu) / 3
locked, sound = deflection(bar, Lambda, mu, growing), deflection(bar, Lambda, mu, 2 * mu)
assert 4 / mu < locked < 0.1 * sound
print(f"deflection with eta = mean of C: {locked:.2f}, with 2 mu: {sound:.1f}, by shear alone: {4 / mu:.2f}")

# %% [markdown]
# **3.** A square with a hanging node has five vertices and ten values. The linear fields have six dimensions, so
# four modes satisfy $\Pi v = 0$. The square without the hanging node has two such modes. The patch test still holds,
# because linear fields still belong to the space.

# %%
square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
hanging = np.insert(square, 1, [0.5, 0.0], axis=0)
for _cell, _modes in ((square, 2), (hanging, 4)):
    assert np.linalg.matrix_rank(np.eye(2 * len(_cell)) - projection(_cell)[1], tol=1e-13) == _modes
straight = np.insert(square @ np.array([[1.0, 0.3], [-0.2, 0.5]]), 1, [0.5, 0.15], axis=0).ravel()
assert np.abs(projection(hanging)[1] @ straight - straight).max() < 1e-13

# %% [markdown]
# **4.** $\int_\omega \nabla v = \sum_i v_i \otimes N_i$ is the integral of all four derivatives. Its symmetric part
# gives the mean strain of $\Pi v$, and its antisymmetric part the mean rotation. The condition on the mean over the
# boundary is not needed for a gradient. The code calls $N_i/|\omega|$ `slopes`.

# %%
pentagon = np.array([[0.0, 0.0], [1.0, -0.1], [1.3, 0.6], [0.6, 1.2], [-0.2, 0.7]])
slopes = vertex_normals(pentagon) / np.sum(vertex_normals(pentagon)[:, 0] * pentagon[:, 0])
v = np.random.default_rng(0).normal(size=(5, 2))
gradient = v.T @ slopes
strain_of_v = projection(pentagon)[0] @ v.ravel()
assert np.abs(strain_of_v - [gradient[0, 0], gradient[1, 1], gradient[0, 1] + gradient[1, 0]]).max() < 1e-13

# %% [markdown]
# **5.** In Pa, all moduli and the load are multiplied by $10^6$. With $\eta = 2\mu$ the whole stiffness matrix is
# multiplied by $10^6$, and $u$ does not change. With $\eta = 1$ the stabilisation does not change, and hourglass modes
# cost almost no energy. So the answer depends on the unit of stress.

# %%
steel = np.array(lame(0.3))
in_pascal = [1e6 * deflection(bar, *(1e6 * steel), eta) for eta in (2e6 * steel[1], 1.0)]
in_megapascal = [deflection(bar, *steel, eta) for eta in (2 * steel[1], 1.0)]
# The condition number of K is below 1e5, and its entries are rounded to 1e-16 of their size.
assert abs(in_pascal[0] / in_megapascal[0] - 1) < 1e-10
assert abs(in_pascal[1] / in_megapascal[1] - 1) > 0.05
for _eta, _values in zip(("2 mu", "1"), zip(in_megapascal, in_pascal, strict=True), strict=True):
    print(f"deflection with eta = {_eta}: {_values[0]:.1f} in MPa, {_values[1]:.1f} in Pa")
