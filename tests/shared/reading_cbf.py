"""Read a program in the Conic Benchmark Format: minimise c'x subject to A x + b in cones."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp


def read_cbf(text):
    """Return c, A, b and a list of cones (kind, size) for the rows of A x + b."""
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    at = {line: k for k, line in enumerate(lines) if line[0].isalpha()}
    assert lines[at["VER"] + 1] == "1"
    assert lines[at["OBJSENSE"] + 1] == "MIN"
    n, domains = map(int, lines[at["VAR"] + 1].split())
    assert [line.split() for line in lines[at["VAR"] + 2 :][:domains]] == [["F", str(n)]]
    m, count = map(int, lines[at["CON"] + 1].split())
    cones = [(kind, int(size)) for kind, size in (line.split() for line in lines[at["CON"] + 2 :][:count])]
    assert sum(size for _, size in cones) == m

    def entries(section, width):
        k = at[section]
        rows = [line.split() for line in lines[k + 2 :][: int(lines[k + 1])]]
        return np.array(rows, dtype=float).reshape(-1, width)

    cost, b = np.zeros(n), np.zeros(m)
    for values, section in ((cost, "OBJACOORD"), (b, "BCOORD")):
        found = entries(section, 2)
        values[found[:, 0].astype(int)] = found[:, 1]
    i, j, x = entries("ACOORD", 3).T
    return cost, sp.csr_matrix((x, (i.astype(int), j.astype(int))), shape=(m, n)), b, cones


def to_second_order(cost, A, b, cones):
    """Convert rotated cones, 2 x_0 x_1 >= |z|^2, to second-order cones of (x_0 + x_1, x_0 - x_1, 2^{1/2} z)."""
    turns = []
    for kind, size in cones:
        turn = sp.eye_array(size)
        if kind == "QR":
            turn = sp.block_diag([np.array([[1.0, 1.0], [1.0, -1.0]]), np.sqrt(2) * sp.eye_array(size - 2)])
        turns.append(turn)
    turn = sp.csr_matrix(sp.block_diag(turns))
    return cost, turn @ A, turn @ b, [("Q" if kind == "QR" else kind, size) for kind, size in cones]
