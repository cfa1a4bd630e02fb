"""Cells: tiny edges, flat angles, needles, cells that see nothing of themselves; on all of them the answer is known."""

from __future__ import annotations

import numpy as np

import vemcvx as vx
from hard.case import WARNING, Case
from hard.ground import drawn, fitted, known, short_edges

COMB = ("aaaaaaaa", "abababab", "abababab", "abababab", "bbbbbbbb")
SPIRAL = ("aaaaaaa", "bbbbbba", "baaaaba", "babbaba", "babbbba", "baaaaaa", "bbbbbbb")


def polygon_among_triangles(corners):
    """A regular polygon in the middle of a square, the rest triangles."""
    angle = 2 * np.pi * np.arange(corners) / corners
    ring = 0.5 + 0.4 * np.column_stack([np.cos(angle), np.sin(angle)])
    box = [(1.0, 1.0), (0.0, 1.0), (0.0, 0.0), (1.0, 0.0)]
    spokes = [[(k + 1) % corners, k, corners + 4 * k // corners] for k in range(corners)]
    sides = [[side * corners // 4, corners + (side - 1) % 4, corners + side] for side in range(4)]
    return np.vstack([ring, box]), [list(range(corners)), *spokes, *sides]


def squashed(aspect):
    """Squares squeezed to a layer of needles along the floor, of that aspect ratio."""
    nx, ny = 8, 8
    heights = np.concatenate([np.linspace(0, 0.125 * ny / aspect, ny), [1.0]])
    points = np.array([(x, y) for y in heights for x in np.linspace(0, 1, nx + 1)])
    first = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
    return points, first[:, None] + [0, 1, nx + 2, nx + 1]


def flat_angles(n, more):
    """Squares with `more` vertices on every edge."""
    mesh = vx.meshes.squares(n)
    edges = {}
    points, cells = [*mesh.points], []
    for cell in mesh.cells:
        outline = []
        for a, b in zip(cell, np.roll(cell, -1), strict=True):
            key = min(a, b), max(a, b)
            if key not in edges:
                share = np.arange(1, more + 1) / (more + 1)
                edges[key] = range(len(points), len(points) + more)
                points += list(mesh.points[key[0]] + share[:, None] * (mesh.points[key[1]] - mesh.points[key[0]]))
            between = list(edges[key])
            outline += [a, *(between if a < b else between[::-1])]
        cells.append(outline)
    return np.array(points), cells


def moved(points, cells, offset):
    return known(vx.PolygonMesh(points * [2.0, 0.5] + offset, cells), origin=(offset, offset))


def cells_of(mesh):
    return mesh.points, mesh.cells


def renumbered():
    mesh = vx.meshes.voronoi(6)
    random = np.random.default_rng(3)
    order = random.permutation(mesh.n_nodes)
    cells = [np.roll(order[cell], k) for k, cell in enumerate(mesh.cells)]
    return mesh.points[np.argsort(order)], [cells[c] for c in random.permutation(mesh.n_cells)]


def clockwise(which):
    mesh = vx.meshes.voronoi(5)
    return mesh.points, [cell[::-1] if which(c) else cell for c, cell in enumerate(mesh.cells)]


def mirrored():
    mesh = vx.meshes.voronoi(6)
    return (mesh.points * [-1, 1] + [1, 0]), [cell[::-1] for cell in mesh.cells]


def sound(name, points_and_cells, **more):
    return Case(name, lambda: known(fitted(*points_and_cells())), **more)


CASES = (
    *(sound(f"edges of {part:.0e} h", lambda part=part: short_edges(6, part)) for part in (1e-3, 1e-6, 1e-9, 1e-12)),
    Case("hanging nodes", lambda: known(vx.meshes.hanging(8, box=((0, 2), (0, 0.5))))),
    sound("20 flat angles an edge", lambda: flat_angles(4, 20)),
    Case("non-convex cells", lambda: known(vx.meshes.nonconvex(8, box=((0, 2), (0, 0.5))))),
    sound("two combs", lambda: drawn(*COMB)),
    sound("two spirals, centroids outside", lambda: drawn(*SPIRAL)),
    sound("an L and a square", lambda: drawn("ab", "aa")),
    sound("a U and what fills it", lambda: drawn("aba", "aba", "aaa")),
    *(sound(f"aspect ratio {aspect:.0e}", lambda aspect=aspect: squashed(aspect)) for aspect in (1e2, 1e4, 1e6)),
    sound("a 500-gon among triangles", lambda: polygon_among_triangles(500)),
    sound("a single cell", lambda: ([(0, 0), (1, 0), (1, 1), (0, 1)], [[0, 1, 2, 3]])),
    sound("a single cell of 200 vertices", lambda: flat_angles(1, 49)),
    sound("all cells clockwise", lambda: clockwise(lambda c: True), must=WARNING, says="listed clockwise"),
    sound("mixed orientation", lambda: clockwise(lambda c: c % 2), must=WARNING, says="listed clockwise"),
    Case("coordinates offset by 1e6", lambda: moved(*cells_of(vx.meshes.voronoi(6)), 1e6)),
    sound("renumbered", renumbered),
    sound("mirrored", mirrored),
)
