"""Read every instance back, solve it by Clarabel and HiGHS, and confirm the certified optimum.

    python confirm.py [FOLDER]

Needs numpy, scipy, clarabel and highspy only. With d_1, d_2 two answers to one program and gap_1, gap_2 their gaps,

    |d_1 - d_2|_K <= (2 gap_1)^(1/2) + (2 gap_2)^(1/2),

and the intervals [primal - gap, primal] of both hold the least value. Both are tested, with gaps computed here; and who
solves what is counted, by the distance of the answer from the certified optimum relative to |d|_K, and by its certified
error, which needs no optimum and may be far larger. Each solver is given the numbers of the file as they are, with its
defaults and with the tolerance that its line names; Clarabel also with two inequalities in place of a cone. Tolerances
of two solvers do not mean the same: `vemcvx benchmark` sweeps them. Of a sequence every step is solved, each begun
cold; its errors are the largest, in units of the largest |d|_K of its steps. Instances that are infeasible or unbounded
have a vector that proves it, which is tested: p >= 0 with D'p = 0 and e'p < 0, or d with K d = 0, D d <= 0, g'd > sum
w|Bd|. Steps with Coulomb's law in FCLIB's form are looked at where h5py is installed: their solution is put into every
line of the law, and its gap as that of the convex program with the weights mu r_N is computed.
"""

from __future__ import annotations

import copy
import csv
import json
import sys
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import clarabel
import highspy
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu

ASKED = 1e-3, 1e-6, 1e-9
SECONDS = 10.0
"""Seconds of a solver for an instance."""
EPS = float(np.finfo(float).eps)


class Program:
    """min 1/2 d'Kd - g'd + sum w|Bd - b| under Dd <= e (or (Dd - e)_+^2 / 2c), from an NPZ; or a sequence of those."""

    def __init__(self, path: Path):
        with np.load(path) as file:
            kept = {name: file[name] for name in file.files}
        for name in ("K", "B", "D"):
            if name not in kept:
                data, indices, indptr, shape = (kept[f"{name}_{k}"] for k in ("data", "indices", "indptr", "shape"))
                kept[name] = sp.csr_matrix((data, indices, indptr), shape=shape)
                kept[name].check_format(full_check=True)  # of a damaged file SciPy would read beyond the ends
                assert (indptr[1:] >= indptr[:-1]).all()
        self.K, self.B, self.D = (sp.csc_matrix(kept[name]) for name in ("K", "B", "D"))
        self.g, self.w, self.b, self.e, self.c = (kept[name] for name in ("g", "w", "b", "e", "c"))
        self.N = kept.get("N", np.zeros((self.g.shape[-1], 0)))
        """The kernel of K, in columns, orthonormal."""
        if "d" in kept:
            self.d, self.lam, self.p = kept["d"], kept["lam"].reshape(self.b.shape), kept["p"]
        self.block = self.b.shape[-1] // self.w.shape[-1] if self.w.size else 1
        """Components of a norm term: one in the plane, two in space."""
        # Rows of limits read one unknown each.
        assert (np.diff(sp.csr_matrix(self.D).indptr) == 1).all()
        if self.N.size:
            self.solve: Callable[[Any], Any] = la.pinvh(self.K.toarray()).dot
        elif isinstance(kept["K"], np.ndarray):
            self.solve = partial(la.cho_solve, la.cho_factor(kept["K"]))
        else:
            self.solve = splu(self.K).solve

    def steps(self) -> list[Program]:
        """The programs of a sequence, whose vectors have a row a step; else the program itself."""
        if self.g.ndim == 1:
            return [self]
        every = [copy.copy(self) for _ in self.g]
        for k, one in enumerate(every):
            one.g, one.w, one.b, one.e, one.d, one.lam, one.p = (
                x[k] for x in (self.g, self.w, self.b, self.e, self.d, self.lam, self.p)
            )
        return every

    def norm(self, d: Any) -> float:
        """|d|_K."""
        return float(np.sqrt(max(d @ (self.K @ d), 0.0)))

    def feasible(self, d: Any) -> Any:
        """d within its hard bounds."""
        d, D = d.copy(), sp.csr_matrix(self.D)
        for i, x, e in zip(D.indices[self.c == 0], D.data[self.c == 0], self.e[self.c == 0], strict=True):
            d[i] = min(d[i], e / x) if x > 0 else max(d[i], e / x)
        return d

    def certified(self, d: Any, lam: Any, p: Any) -> tuple[float, float, float]:
        """Primal value, gap, and what rounding may hide in it, of any d within its bounds."""
        size, p = np.linalg.norm(lam.reshape(-1, self.block), axis=1), np.maximum(p, 0.0)
        share = np.where(size > self.w, self.w / np.where(size > 0, size, 1.0), 1.0)
        lam = lam * np.repeat(share, self.block)
        s, z, soft = self.B @ d - self.b, self.D @ d - self.e, self.c > 0
        slips = np.linalg.norm(s.reshape(-1, self.block), axis=1)
        r = self.g - self.B.T @ lam - self.D.T @ p - self.K @ d
        held = np.where(soft & (z > 0), (z - self.c * p) ** 2 / np.where(soft, 2 * self.c, 1.0), 0.0)
        open_ = np.where(z <= 0, 0.5 * self.c * p * p - p * z, 0.0)
        gap = 0.5 * abs(r @ self.solve(r)) + float(self.w @ slips - lam @ s + held.sum() + open_.sum())
        pressed = 0.5 * float((np.maximum(z, 0.0)[soft] ** 2 / self.c[soft]).sum())
        primal = 0.5 * d @ (self.K @ d) - self.g @ d + self.w @ slips + pressed
        size = abs(self.g) + abs(self.B.T) @ abs(lam) + abs(self.D.T) @ p + abs(self.K) @ abs(d)
        floor = 0.5 * EPS**2 * abs(size @ abs(self.solve(size)))
        floor += EPS * float((abs(self.B) @ abs(d) + abs(self.b)) @ np.repeat(self.w, self.block))
        floor += EPS * float((abs(self.D) @ abs(d) + abs(self.e)) @ p)
        # Forces that are off balance by so much do work on motions in the kernel.
        floor += float(abs(self.N.T @ r) @ abs(self.N.T @ d))
        return float(primal), gap, floor + len(d) * EPS * float(size @ abs(d))


def proved(program: Program, status: str, vector: Any) -> bool:
    """True if the vector proves that the program is infeasible, or unbounded, but for rounding."""
    size = float(abs(vector).max())
    if status == "infeasible":
        rigid = bool((program.c[vector > 0] == 0).all() and (vector >= 0).all())
        return rigid and float(program.e @ vector) < 0 and float(abs(program.D.T @ vector).max()) <= 1e-12 * size
    slip = np.linalg.norm((program.B @ vector).reshape(-1, program.block), axis=1)
    still = abs(program.K @ vector).max() <= 1e-10 * abs(program.K).max() * size
    free = (program.D @ vector).max(initial=0.0) <= 1e-12 * size
    return bool(still and free and program.g @ vector > program.w @ slip)


def misses(path: Path) -> dict[str, float]:
    """The residual of a step's solution in FCLIB's equations of Coulomb's law, relative to the largest term.

    "error" is a bound on |v - v*|_M / |v|_M, v* the answer to the convex program whose weights are mu r_N.
    """
    with import_module("h5py").File(path) as file:
        problem, v, r = file["fclib_global"], file["solution"]["v"][()], file["solution"]["r"][()]
        M, H = (
            sp.csr_matrix((A["x"][()], A["i"][()], A["p"][()]), shape=(A["m"][0], A["n"][0]))
            for A in (problem["M"], problem["H"])
        )
        f, w, mu = (problem["vectors"][name][()] for name in ("f", "w", "mu"))
        u = H.T @ v + w
        moved = abs(u - file["solution"]["u"][()]).max() / abs(u).max()
    r_N, u_N, r_T, u_T = (
        r.reshape(len(mu), -1)[:, 0],
        u.reshape(len(mu), -1)[:, 0],
        *(x.reshape(len(mu), -1)[:, 1:] for x in (r, u)),
    )
    slip, off = np.linalg.norm(u_T, axis=1), M @ v - H @ r - f
    work = r_N * u_N + mu * r_N * slip + (r_T * u_T).sum(axis=1)
    against = np.linalg.norm(slip[:, None] * r_T + (mu * r_N)[:, None] * u_T, axis=1)
    force, way = abs(r).max(), abs(u).max()
    gap = 0.5 * float(off @ splu(sp.csc_matrix(M)).solve(off)) + float(work.sum())
    return {
        "balance": float(abs(off).max() / (abs(M) @ abs(v) + abs(H) @ abs(r) + abs(f)).max()),
        "kinematics": float(moved),
        "penetration": float(-u_N.min(initial=0.0) / way),
        "tension": float(-r_N.min(initial=0.0) / force),
        "complementarity": float(abs(r_N * u_N).max() / (force * way)),
        "cone": float((np.linalg.norm(r_T, axis=1) - mu * r_N).max(initial=0.0) / force),
        "against the slip": float(against.max() / (force * way)),
        "error": float(np.sqrt(2 * abs(gap) / (v @ (M @ v)))),
    }


def quadratic(program: Program, cones: bool) -> tuple[Any, Any, Any, Any]:
    """P, q, A, b of min 1/2 x'Px + q'x in x = (d, t, s) under Ax <= b, or cones (t_i, B_i d - b_i) and Ax <= b."""
    m, r, one = len(program.w), len(program.e), sp.eye(len(program.w))
    P = sp.csc_matrix(sp.block_diag([program.K, sp.csc_matrix((m, m)), sp.diags(program.c)]))
    q = np.concatenate([-program.g, program.w, np.zeros(r)])
    blocks: Any = [[None, -one], [-program.B, None]] if cones else [[program.B, -one], [-program.B, -one]]
    rows = sp.csr_matrix(sp.bmat(blocks))
    right = np.concatenate([np.zeros(m) if cones else program.b, -program.b])
    if cones:
        terms = m + np.arange(m * program.block).reshape(m, program.block)
        order = np.hstack([np.arange(m)[:, None], terms]).ravel()
        rows, right = rows[order], right[order]
    limits = sp.hstack([program.D, sp.csr_matrix((r, m)), -sp.diags(program.c)])
    A = sp.vstack([sp.hstack([rows, sp.csr_matrix((rows.shape[0], r))]), limits])
    return P, q, sp.csc_matrix(A), np.concatenate([right, program.e])


def by_clarabel(program: Program, tight: bool, cones: bool = True) -> tuple[Any, Any, Any]:
    """d, lam, p by second-order cones, or by inequalities."""
    m, r, size = len(program.w), len(program.e), 1 + program.block
    P, q, A, b = quadratic(program, cones)
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.time_limit = False, SECONDS
    if tight:
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-12
    kinds = [clarabel.SecondOrderConeT(size)] * m if cones else [clarabel.NonnegativeConeT(2 * m)] * (m > 0)
    kinds += [clarabel.NonnegativeConeT(r)] * (r > 0)
    data = sp.csc_matrix(sp.triu(P)), q, A, b, kinds, settings
    found = clarabel.DefaultSolver(*data).solve()
    z = np.array(found.z)
    terms = z[: size * m]
    lam = -terms.reshape(m, size)[:, 1:].ravel() if cones else terms[:m] - terms[m:]
    return np.array(found.x)[: len(program.g)], lam, z[size * m :]


def by_highs(program: Program, tight: bool) -> tuple[Any, Any, Any]:
    """d, lam, p by inequalities."""
    n, m, r = len(program.g), len(program.w), len(program.e)
    P, q, A, b = quadratic(program, cones=False)
    P, infinite, highs = sp.csc_matrix(sp.tril(P)), highspy.kHighsInf, highspy.Highs()
    highs.silent()
    highs.setOptionValue("time_limit", SECONDS)
    if tight:
        for name in ("primal_feasibility_tolerance", "dual_feasibility_tolerance"):
            highs.setOptionValue(name, 1e-10)  # HiGHS takes no less
    model = highspy.HighsModel()
    lp = model.lp_
    lp.num_row_, lp.num_col_ = A.shape
    lp.col_cost_ = q
    lp.col_lower_ = np.concatenate([np.full(n, -infinite), np.zeros(m + r)])
    lp.col_upper_ = np.full(len(q), infinite)
    lp.row_lower_, lp.row_upper_ = np.full(len(b), -infinite), b
    lp.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    lp.a_matrix_.start_, lp.a_matrix_.index_, lp.a_matrix_.value_ = A.indptr, A.indices, A.data
    model.hessian_.dim_, model.hessian_.format_ = len(q), highspy.HessianFormat.kTriangular
    model.hessian_.start_, model.hessian_.index_, model.hessian_.value_ = P.indptr, P.indices, P.data
    highs.passModel(model)
    highs.run()
    found = highs.getSolution()
    x, duals = np.array(found.col_value), -np.array(found.row_dual)
    if len(x) != len(q) or len(duals) != len(b) or not np.isfinite(x).all():
        return np.zeros(n), np.zeros(m), np.zeros(r)
    return x[:n], duals[:m] - duals[m : 2 * m], duals[2 * m :]


SOLVERS: dict[str, tuple[Callable[..., Any], bool]] = {
    "Clarabel": (by_clarabel, False),
    "Clarabel 1e-12": (by_clarabel, True),
    "same, no cones": (partial(by_clarabel, cones=False), True),
    "HiGHS": (by_highs, False),
    "HiGHS 1e-10": (by_highs, True),
}
CONIC = "Clarabel", "Clarabel 1e-12"
"""The solvers that take norms of more than one component."""


def confirmed(programs: list[Program], name: str) -> dict[str, Any]:
    """One solver on one instance: how long, how well, and whether it contradicts a certified optimum."""
    unit = max(program.norm(program.d) for program in programs) or 1.0
    rows = [_confirmed(program, name, unit) for program in programs]
    worst: dict[str, Any] = {key: max(row[key] for row in rows) for key in rows[0] if key != "seconds"}
    right = bool(all(row["confirmed"] for row in rows))
    return {"solver": name, "seconds": sum(row["seconds"] for row in rows), **worst, "confirmed": right}


def _confirmed(program: Program, name: str, unit: float) -> dict[str, float]:
    solve, tight = SOLVERS[name]
    start = time.perf_counter()
    d, lam, p = solve(program, tight)
    seconds = time.perf_counter() - start
    s = program.D @ d - program.e
    over = float(np.maximum(s[program.c == 0], 0.0).max(initial=0.0))
    d = program.feasible(d)
    ours, theirs = program.certified(program.d, program.lam, program.p), program.certified(d, lam, p)
    errors = [np.sqrt(2 * (gap + floor)) for _, gap, floor in (ours, theirs)]
    low = max(value - gap - floor for value, gap, floor in (ours, theirs))
    high = min(value + floor for value, gap, floor in (ours, theirs))
    near = program.norm(d - program.d) <= sum(errors)
    balance = program.g - program.B.T @ lam - program.D.T @ p - program.K @ d
    return {
        "seconds": seconds,
        "primal_residual": over,
        "dual_residual": float(abs(balance).max(initial=0.0)),
        "gap": theirs[1],
        "certified": float(np.sqrt(2 * theirs[1]) / unit),
        "true": program.norm(d - program.d) / unit,
        "confirmed": float(near and low <= high),
    }


def main(folder: Path) -> int:
    """The whole folder: a table in results.csv, counts in words; 0 where every optimum was confirmed."""
    instances, rows = json.loads((folder / "manifest.json").read_text())["instances"], []
    proofs: dict[str, bool] = {}
    laws: dict[str, dict[str, float]] = {}
    steps = 0
    for instance in instances:
        if instance["grade"] == "fclib":
            steps += instance.get("steps", 1)
            paths = sorted(folder.glob(f"{instance['name']}-*.hdf5")) if find_spec("h5py") else []
            laws |= {path.stem: misses(path) for path in paths}
            continue
        program, *others = Program(folder / f"{instance['name']}.npz").steps()
        if "certificate" in instance:
            proofs[instance["name"]] = proved(program, instance["status"], np.array(instance["certificate"]))
            continue
        # HiGHS may take very long for more than a hundred unknowns, its limit of time notwithstanding.
        small, own = len(program.g) <= 100 and not others, {name: instance[name] for name in ("name", "grade")}
        able = [name for name in SOLVERS if program.block == 1 or name in CONIC]
        able = [name for name in able if small or not name.startswith("HiGHS")]
        rows += [{**own, **confirmed([program, *others], name)} for name in able]
    with open(folder / "results.csv", "w", newline="") as file:
        table = csv.DictWriter(file, list(rows[0]))
        table.writeheader()
        table.writerows(rows)
    wrong = [f"NOT CONFIRMED: {row['name']} by {row['solver']}" for row in rows if not row["confirmed"]]
    unproved = [f"NOT PROVED: {name}" for name, right in proofs.items() if not right]
    print(*wrong, *unproved, sep="\n", end="\n" * bool(wrong or unproved))
    right, rest = f"{len(rows) - len(wrong)} of {len(rows)}", len({row["name"] for row in rows})
    print(f"{right} answers to {rest} instances confirm the certified optima")
    print(f"{len(proofs) - len(unproved)} of {len(proofs)} instances are proved to have no optimum")
    # The root of a gap that is rounding is no less than 1e-8 or so.
    errors = {name: missed.pop("error") for name, missed in laws.items()}
    solved = [name for name, missed in laws.items() if max(missed.values()) <= ASKED[2] and errors[name] <= ASKED[1]]
    if steps:
        worst = max((max(missed.values()) for missed in laws.values()), default=np.nan), max(errors.values(), default=0)
        said = "off by {:.1e} at most, by {:.1e} in energy".format(*worst)
        said = said if laws else "looked at where h5py is installed"
        print(f"{len(solved)} of {steps} steps in FCLIB's form obey Coulomb's law: {said}")
    say(rows)
    return 1 if wrong or unproved or len(solved) < len(laws) else 0


def say(rows: list[dict[str, Any]]) -> None:
    """Counts of what each solver reaches, by true and by certified errors."""
    print(f"{'':15}       {'true error':^21} {'certified error':^21}")
    print(f"{'solver':15} tried {' '.join(''.join(f'{error:7.0e}' for error in ASKED) for _ in range(2))}")
    for solver in dict.fromkeys(row["solver"] for row in rows):
        own = [row for row in rows if row["solver"] == solver]
        counts = [[sum(row[kind] <= error for row in own) for error in ASKED] for kind in ("true", "certified")]
        print(f"{solver:15} {len(own):5d} {' '.join(''.join(f'{count:7d}' for count in some) for some in counts)}")


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent))
