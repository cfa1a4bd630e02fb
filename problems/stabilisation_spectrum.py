r"""The ratio of the stabilisation to the energy that it replaces, cell by cell: a robustness chart.

The components of a virtual function v are harmonic in the cell K and linear on its edges. Pi projects v on linear
fields. If Pi v = 0, the discrete energy a_K^h(v, v) is the stabilisation S(v, v) = 2 mu sum_i |v_i|^2 alone, with the
values v_i at vertices. The stabilisation replaces the exact energy a_mu + a_lam (lam is Lame's lambda),

$$ a_\mu(v, v) = 2 \mu \int |\varepsilon(v)|^2, \qquad a_\lambda(v, v) = \lambda \int |\operatorname{div} v|^2. $$

The chart shows the least and the greatest ratio S / a_mu over all v with Pi v = 0. Neither ratio depends on mu, on the
size of the cell or on nu. If both ratios lie between positive constants, a_K^h is equivalent to the form

$$ a_\mu(v, v) + \lambda |K| (\text{mean of } \operatorname{div} v)^2. $$

This form does not lock. The last column of the chart is the least S / (a_mu + a_lam), at nu = .499999 unless the row
names nu. For large lam this ratio goes to zero like 1 / lam, *because* S does not contain lam: S does not penalise
variations of the dilatation within a cell.

On a rectangle 2a x 2b, only combinations of (xy, 0) and (0, xy) have Pi v = 0. For these two fields S / a_mu is
6ab / (a^2 + 2b^2) and 6ab / (b^2 + 2a^2), because int |eps|^2 of (xy / ab, 0) is 4 (b^2 + a^2 / 2) / (3ab). On a
square both ratios are 2. On other cells, v is computed by linear finite elements on a mesh graded towards the vertices.
The computed energies are a few per cent too high.

Results: over all families of meshes S / a_mu stays between .5 and 7. In a cell of size h, an edge of length e h lowers
the least ratio by a logarithmic factor only: S / a_mu >= c / log(1 / e). On stretched hexagons the least ratio falls
like the inverse of the aspect ratio, and the greatest ratio grows in proportion to the aspect ratio. On stretched
rectangles both ratios fall.

    python problems/stabilisation_spectrum.py [--picture FILE]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from scipy.linalg import eigh, null_space
from scipy.sparse.linalg import splu
from scipy.spatial import Delaunay

import vemcvx as vx
from vemcvx.base.canvas import light_grid, new_figure, plain_logarithms
from vemcvx.plots.style import COMPUTED, SECOND
from vemcvx.vem import CellGroup

COARSE, GRADING = 1 / 14, 0.28
POISSONS = (0.3, 0.45, 0.499, 0.499999)


def local_size(points, corners, smallest):
    """Return the largest allowed size of triangles at points: a fraction of the distance to the nearest vertex."""
    away = np.linalg.norm(points[:, None] - corners[None], axis=2).min(axis=1)
    return np.clip(GRADING * away, smallest, COARSE)


def is_inside(points, corners):
    """Return a mask of the points inside the polygon."""
    a, b = corners, np.roll(corners, -1, axis=0)
    x, y = points.T
    straddles = (a[:, 1] > y[:, None]) != (b[:, 1] > y[:, None])
    height = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    crossing = a[:, 0] + (y[:, None] - a[:, 1]) / height * (b[:, 0] - a[:, 0])
    return (straddles & (x[:, None] < crossing)).sum(axis=1) % 2 == 1


def outline(corners, smallest):
    """Return points along the edges, the vertices first."""
    parts = [corners]
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        cuts = np.array([0.0, 1.0])
        while True:
            middle = 0.5 * (cuts[1:] + cuts[:-1])
            long = np.diff(cuts) * np.linalg.norm(b - a) > local_size(a + middle[:, None] * (b - a), corners, smallest)
            if not long.any():
                break
            cuts = np.sort(np.concatenate([cuts, middle[long]]))
        parts.append(a + cuts[1:-1, None] * (b - a))
    return np.vstack(parts)


def interior(corners, smallest):
    """Return the centres of squares that fill the polygon, without the centres near its outline."""
    centres, half, found = np.mean([corners.min(axis=0), corners.max(axis=0)], axis=0)[None], np.ptp(corners), []
    a, b = corners, np.roll(corners, -1, axis=0)
    while len(centres):
        size = local_size(centres, corners, smallest)
        fine = 2 * half <= size
        found.append(centres[fine])
        quarter = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half / 2
        centres, half = (centres[~fine][:, None] + quarter).reshape(-1, 2), half / 2
    points = np.vstack(found)
    points = points[is_inside(points, corners)]
    edge = b - a
    along = np.clip(np.einsum("ped,ed->pe", points[:, None] - a, edge) / np.einsum("ed,ed->e", edge, edge), 0, 1)
    gap = np.linalg.norm(points[:, None] - a - along[:, :, None] * edge, axis=2).min(axis=1)
    return points[gap > 0.4 * local_size(points, corners, smallest)]


def virtual_energies(corners):
    """Return int |eps(v)|^2 and int |div v|^2 as matrices (2n, 2n) for the values of v at the vertices of a cell."""
    edges = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    smallest = 0.25 * edges.min()
    rim = outline(corners, smallest)
    points = np.vstack([rim, interior(corners, smallest)])
    triangles = Delaunay(points).simplices
    triangles = triangles[is_inside(points[triangles].mean(axis=1), corners)]
    p, n, total = points[triangles], len(corners), len(points)
    turned = np.roll(p, -1, axis=1) - np.roll(p, 1, axis=1)
    one, other = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    area = 0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
    keep = area > 1e-3 * smallest**2
    triangles, turned, area = triangles[keep], turned[keep], area[keep]
    gradient = np.stack([turned[:, :, 1], -turned[:, :, 0]], axis=2) / (2 * area[:, None, None])
    gradient *= np.sign(np.einsum("tia,tia->t", p[keep], gradient))[:, None, None]
    rows, columns = np.repeat(np.arange(len(area)), 3), triangles.ravel()
    D = [sp.csr_matrix((gradient[:, :, a].ravel(), (rows, columns)), shape=(len(area), total)) for a in (0, 1)]
    W = sp.diags_array(area)
    values = extend_harmonically(sp.csc_matrix(D[0].T @ W @ D[0] + D[1].T @ W @ D[1]), rim, corners, total)
    dx, dy = D[0] @ values, D[1] @ values
    xx, yy, xy = (first.T @ (area[:, None] * second) for first, second in ((dx, dx), (dy, dy), (dx, dy)))
    strain = np.block([[xx + 0.5 * yy, 0.5 * xy.T], [0.5 * xy, yy + 0.5 * xx]])
    return strain, np.block([[xx, xy], [xy.T, yy]])[: 2 * n, : 2 * n]


def extend_harmonically(K, rim, corners, total):
    """Return the values (total, n) of the n hat functions, linear on the outline and harmonic inside, at all points."""
    n, m = len(corners), len(rim)
    values = np.zeros((total, n))
    for i, (a, b) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True)):
        length = (b - a) @ (b - a)
        fraction = (rim - a) @ (b - a) / length
        off = np.abs((rim - a)[:, 0] * (b - a)[1] - (rim - a)[:, 1] * (b - a)[0]) / length
        here = (off < 1e-9) & (fraction >= -1e-12) & (fraction <= 1 + 1e-12)
        values[:m][here, i] = 1 - fraction[here]
        values[:m][here, (i + 1) % n] = fraction[here]
    free = np.arange(m, total)
    if len(free):
        values[free] = splu(K[free][:, free]).solve(-(K[free][:, :m] @ values[:m]))
    return values


def spectrum(corners, poisson=0.3):
    """Return least and greatest S / a_mu, and least S / (a_mu + a_lam), over v with Pi v = 0, for mu = 1."""
    corners = np.asarray(corners, dtype=float)
    diameter = np.linalg.norm(corners[:, None] - corners[None], axis=2).max()
    corners = (corners - corners.mean(axis=0)) / diameter
    cell = CellGroup(np.arange(1), np.arange(len(corners))[None], corners)
    N = null_space(cell.vertex_values()[0], rcond=1e-9)
    if N.shape[1] == 0:
        return np.nan, np.nan, np.nan
    N = np.kron(np.eye(2), N)
    strain, dilatation = virtual_energies(corners)
    S, shear = 2 * N.T @ N, 2 * N.T @ strain @ N
    whole = shear + 2 * poisson / (1 - 2 * poisson) * (N.T @ dilatation @ N)
    ratios = eigh(S, shear, eigvals_only=True)
    return ratios[0], ratios[-1], eigh(S, whole, eigvals_only=True)[0]


def square_without_corner(ratio):
    """Return a unit square with an edge of length `ratio` in place of a corner."""
    cut = ratio / np.sqrt(2)
    return [(0, 0), (1, 0), (1, 1 - cut), (1 - cut, 1), (0, 1)]


def chart():
    """Return rows (name, least, greatest, least with dilatation) of the robustness chart."""
    rows = []
    for family, make in vx.meshes.FAMILIES.items():
        mesh = make(5, seed=1)
        chosen = [cell for cell in mesh.cells if len(cell) > 3][:: max(1, mesh.n_cells // 8)]
        found = np.array([spectrum(mesh.points[cell], POISSONS[-1]) for cell in chosen])
        if len(found):
            rows.append((f"{family}, {len(found)} cells", found[:, 0].min(), found[:, 1].max(), found[:, 2].min()))
    near = POISSONS[-1]
    cuts, aspects = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6), (1, 3, 10, 30, 100)
    rows += [(f"edge ratio {ratio:.0e}", *spectrum(square_without_corner(ratio), near)) for ratio in cuts]
    rows += [(f"aspect ratio {aspect}, hexagon", *spectrum(hexagon(aspect), near)) for aspect in aspects]
    rows += [(f"nu = {poisson}, hexagon", *spectrum(hexagon(1), poisson)) for poisson in POISSONS]
    return rows


def hexagon(aspect):
    """Return a regular hexagon, stretched along x by the factor `aspect`."""
    angle = np.pi / 3 * np.arange(6)
    return np.column_stack([aspect * np.cos(angle), np.sin(angle)])


def draw(rows, path):
    """Draw the interval [least, greatest] S / a_mu of every row."""
    figure = new_figure(9.0, 0.26 * len(rows) + 1.2)
    left, right = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    place = np.arange(len(rows))[::-1]
    low, high, whole = (np.array([row[k] for row in rows]) for k in (1, 2, 3))
    left.hlines(place, low, high, linewidth=4, color=COMPUTED)
    left.plot(low, place, "|", high, place, "|", color=COMPUTED, markersize=9)
    left.axvline(1.0, color="0.4", linewidth=0.8)
    left.set_title(r"$S\,/\,a_\mu$ on $\Pi v = 0$: least to greatest", fontsize="medium")
    right.plot(whole, place, "D", color=SECOND, markersize=4)
    right.set_title(
        r"least $S\,/\,(a_\mu + a_\lambda)$ at $\nu = 0.499999$,"
        "\nor at the $\\nu$ of the row",
        fontsize="medium",
    )
    left.set_yticks(place, [row[0] for row in rows], fontsize="small")
    for axes in (left, right):
        axes.set_xscale("log")
        light_grid(axes)
    plain_logarithms(left.xaxis, [1.0])
    figure.savefig(path, dpi=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", type=Path, help="where to draw the chart (PNG)")
    chosen = parser.parse_args()
    rows = chart()
    print(f"{'cell':<28} {'least S/a_mu':>13} {'greatest':>10} {'least with lam':>15}")
    for name, low, high, whole in rows:
        print(f"{name:<28} {low:>13.3f} {high:>10.3f} {whole:>15.2e}")
    if chosen.picture:
        draw(rows, chosen.picture)


if __name__ == "__main__":
    main()
