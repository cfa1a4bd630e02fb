"""Read every instance, solve it by Clarabel, and confirm the certified optimum.

    python confirm.py [FOLDER]

The script needs numpy, scipy and clarabel only. An instance is a program, or a sequence of programs. A file holds
the matrices K, B, D and the vectors g, w, b, e, c of programs

    minimise 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i|  subject to  D d <= e.

If c_j > 0, limit j is soft: the term max(D_j d - e_j, 0)^2 / (2 c_j) replaces D_j d <= e_j. Let |d|_K = (d'Kd)^(1/2).
Two answers d_1 and d_2 with objectives v_1 and v_2 and duality gaps gap_1 and gap_2 satisfy

    |d_1 - d_2|_K <= (2 gap_1)^(1/2) + (2 gap_2)^(1/2),     v_i - gap_i <= minimum <= v_i.

The script computes the gaps from the numbers in the file, and tests these inequalities in every step.

A vector p >= 0 with D'p = 0 and e'p < 0 proves that a program is infeasible. A vector d with K d = 0, D d <= 0 and
g'd > sum_i w_i |B_i d| proves that a program is unbounded.
"""

from __future__ import annotations

import copy
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import clarabel
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.sparse.linalg import splu

TIGHT = 1e-12  # Clarabel's tolerances.
EPS = float(np.finfo(float).eps)


class Program:
    """A program, or a sequence of programs, from an NPZ file."""

    def __init__(self, path: Path):
        with np.load(path) as file:
            kept = {name: file[name] for name in file.files}
        for name in ("K", "B", "D"):
            if name not in kept:
                data, indices, indptr, shape = (kept[f"{name}_{k}"] for k in ("data", "indices", "indptr", "shape"))
                kept[name] = sp.csr_matrix((data, indices, indptr), shape=shape)
        self.K, self.B, self.D = (sp.csc_matrix(kept[name]) for name in ("K", "B", "D"))
        self.g, self.w, self.b, self.e, self.c, self.N = (kept[name] for name in ("g", "w", "b", "e", "c", "N"))
        if "d" in kept:
            self.d, self.lam, self.p = kept["d"], kept["lam"].reshape(self.b.shape), kept["p"]
        self.block = self.b.shape[-1] // self.w.shape[-1] if self.w.size else 1
        """Number of components of a norm term: one in the plane, two in space."""
        self.solve: Callable[[Any], Any] = la.pinvh(self.K.toarray()).dot if self.N.size else splu(self.K).solve

    def steps(self) -> list[Program]:
        """Return the programs of the steps."""
        if self.g.ndim == 1:
            return [self]
        every = [copy.copy(self) for _ in self.g]
        for k, one in enumerate(every):
            vars(one).update({name: getattr(self, name)[k] for name in ("g", "w", "b", "e", "d", "lam", "p")})
        return every

    def norm(self, d: Any) -> float:
        """Return |d|_K."""
        return float(np.sqrt(max(d @ (self.K @ d), 0.0)))

    def feasible(self, d: Any) -> Any:
        """Return d clipped to the hard limits, each of which concerns one unknown."""
        d, D = d.copy(), sp.csr_matrix(self.D)
        for i, x, e in zip(D.indices[self.c == 0], D.data[self.c == 0], self.e[self.c == 0], strict=True):
            d[i] = min(d[i], e / x) if x > 0 else max(d[i], e / x)
        return d

    def certify(self, d: Any, lam: Any, p: Any) -> tuple[float, float, float]:
        """Return the primal value, the duality gap, and a bound on rounding errors."""
        size, p = np.linalg.norm(lam.reshape(-1, self.block), axis=1), np.maximum(p, 0.0)
        factor = np.where(size > self.w, self.w / np.where(size > 0, size, 1.0), 1.0)
        lam = lam * np.repeat(factor, self.block)
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
        floor += float(abs(self.N.T @ r) @ abs(self.N.T @ d))
        return float(primal), gap, floor + len(d) * EPS * float(size @ abs(d))

    def run_clarabel(self) -> tuple[Any, Any, Any]:
        """Return d, lam and p from Clarabel."""
        # The unknowns are d, t and s, with t_i >= |B_i d - b_i| and D d - c s <= e.
        n, m, r, block = len(self.g), len(self.w), len(self.e), self.block
        P, q = sp.block_diag([self.K, sp.csc_matrix((m, m)), sp.diags(self.c)]), np.r_[-self.g, self.w, np.zeros(r)]
        cones, one = block > 1, sp.eye(m)  # For an absolute value, two inequalities are more accurate than a cone.
        rows: Any = [[None, -one], [-self.B, None]] if cones else [[self.B, -one], [-self.B, -one]]
        terms, right = sp.csr_matrix(sp.bmat(rows)), np.r_[np.zeros(m) if cones else self.b, -self.b]
        if cones:  # The first row of a cone has t_i, and the next rows have B_i d.
            order = np.hstack([np.arange(m)[:, None], m + np.arange(m * block).reshape(m, block)]).ravel()
            terms, right = terms[order], right[order]
        limits = sp.hstack([self.D, sp.csr_matrix((r, m)), -sp.diags(self.c)])
        A = sp.vstack([sp.hstack([terms, sp.csr_matrix((len(right), r))]), limits], format="csc")
        kinds = [clarabel.SecondOrderConeT(1 + block)] * m if cones else [clarabel.NonnegativeConeT(2 * m)] * (m > 0)
        kinds += [clarabel.NonnegativeConeT(r)] * (r > 0)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.time_limit = False, 60.0
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TIGHT
        data = sp.triu(P, format="csc"), q, A, np.r_[right, self.e], kinds, settings
        found = clarabel.DefaultSolver(*data).solve()
        z = np.array(found.z)
        lam = -z[: len(right)].reshape(m, 1 + block)[:, 1:].ravel() if cones else z[:m] - z[m : 2 * m]
        return np.array(found.x)[:n], lam, z[len(right) :]

    def confirm(self) -> tuple[bool, float]:
        """Return whether Clarabel's answer agrees with the stored answer, and Clarabel's certified error."""
        d, lam, p = self.run_clarabel()
        d = self.feasible(d)
        stored, found = self.certify(self.d, self.lam, self.p), self.certify(d, lam, p)
        errors = [float(np.sqrt(2 * (gap + floor))) for _, gap, floor in (stored, found)]
        low = max(value - gap - floor for value, gap, floor in (stored, found))
        high = min(value + floor for value, gap, floor in (stored, found))
        near = self.norm(d - self.d) <= sum(errors)
        return near and low <= high, errors[1] / (self.norm(self.d) or 1.0)


def is_proof(program: Program, status: str, vector: Any) -> bool:
    """Return True if the vector proves, up to rounding, that the program is infeasible or unbounded."""
    size = float(abs(vector).max())
    if status == "infeasible":
        rigid = bool((program.c[vector > 0] == 0).all() and (vector >= 0).all())
        return rigid and float(program.e @ vector) < 0 and float(abs(program.D.T @ vector).max()) <= 1e-12 * size
    slip = np.linalg.norm((program.B @ vector).reshape(-1, program.block), axis=1)
    still = abs(program.K @ vector).max() <= 1e-10 * abs(program.K).max() * size
    free = (program.D @ vector).max(initial=0.0) <= 1e-12 * size
    return bool(still and free and program.g @ vector > program.w @ slip)


def main(folder: Path) -> int:
    """Confirm the instances of a folder, and return 0 if all are confirmed."""
    if not (folder / "manifest.json").is_file():
        sys.exit(f"{folder} has no manifest.json of a collection; usage: python confirm.py [FOLDER]")
    instances = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["instances"]
    right: dict[str, bool] = {}
    errors, proofs = [], 0
    for instance in instances:
        name = instance["name"]
        if "certificate" in instance:
            proofs += 1
            program = Program(folder / f"{name}.npz")
            right[name] = is_proof(program, instance["status"], np.array(instance["certificate"]))
        else:
            found = [program.confirm() for program in Program(folder / f"{name}.npz").steps()]
            right[name] = all(one for one, _ in found)
            errors.append(max(error for _, error in found))
    print("".join(f"NOT CONFIRMED: {name}\n" for name, known in right.items() if not known), end="")
    confirmed = f"{sum(right.values())} of {len(right)} are confirmed"
    print(f"{confirmed}: {len(errors)} optima, {proofs} proofs that no optimum exists")
    counts = ", ".join(f"{sum(error <= one for error in errors)} within {one:g}" for one in (1e-3, 1e-6, 1e-9))
    print(f"answers of Clarabel, by certified error: {counts}")
    return 0 if all(right.values()) else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent))
