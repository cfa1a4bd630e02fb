"""References of the benchmarks: factorisation by SciPy, assembly by scikit-fem, a step written with cvxpy."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
import skfem
from paper_scene import BOUND, POISSON, YOUNG
from scipy.sparse.linalg import splu
from skfem.models.elasticity import lame_parameters, linear_elasticity


def factor_and_solve(K: sp.csc_matrix, f: np.ndarray) -> np.ndarray:
    """Factorise K and solve once, with the fastest settings of SciPy."""
    return splu(K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).solve(f)


def assemble_elasticity(mesh: skfem.Mesh) -> tuple[sp.csr_matrix, skfem.Basis]:
    """Return the stiffness matrix and the basis of scikit-fem, for Q1 or P1 elements."""
    element = skfem.ElementQuad1() if isinstance(mesh, skfem.MeshQuad) else skfem.ElementTriP1()
    basis = skfem.Basis(mesh, skfem.ElementVector(element))
    return skfem.asm(linear_elasticity(*lame_parameters(YOUNG, POISSON)), basis), basis


def grid(n: int, kind: type[skfem.Mesh]) -> skfem.Mesh:
    """Return the unit square, divided into n x n squares or twice as many triangles."""
    line = np.linspace(0, 1, n + 1)
    return kind.init_tensor(line, line)


def time_user_step(n: int) -> float:
    """Return the solver's seconds for one step, written with scikit-fem and cvxpy."""
    K, basis = assemble_elasticity(grid(n, skfem.MeshQuad))
    x = basis.doflocs
    left = skfem.FacetBasis(basis.mesh, basis.elem, facets=basis.mesh.facets_satisfying(lambda x: x[0] == 0.0))
    load = skfem.LinearForm(lambda v, w: 8 * (1.25 - w.x[1]) * v[0] - 0.01 * v[1])
    f = skfem.asm(load, left)
    right, bottom = x[0] == 1.0, x[1] == 0.0
    is_x = np.zeros(K.shape[0], dtype=bool)
    is_x[basis.nodal_dofs[0]] = True
    free = np.flatnonzero(~(right | (bottom & ~is_x)))
    u = cp.Variable(len(free))
    slides = np.flatnonzero((bottom & is_x)[free])
    weights = np.full(len(slides), BOUND / n)
    weights[np.argmin(x[0][free][slides])] /= 2
    objective = 0.5 * cp.quad_form(u, sp.csc_matrix(K[free][:, free]), assume_PSD=True) - f[free] @ u
    problem = cp.Problem(cp.Minimize(objective + weights @ cp.abs(u[slides])))
    problem.solve(solver="CLARABEL")
    return float(problem.solver_stats.solve_time)
