"""Cells: tiny edges, flat angles, needles, centroids outside of their cells; the solution is known on all meshes."""

from __future__ import annotations

import numpy as np

import vemcvx as vx
from hard.case import WARNING, Case
from hard.ground import draw_cells, fit_box, shear_block, split_nodes

COMB = ("aaaaaaaa", "abababab", "abababab", "abababab", "bbbbbbbb")
SPIRAL = ("aaaaaaa", "bbbbbba", "baaaaba", "babbaba", "babbbba", "baaaaaa", "bbbbbbb")


def polygon_among_triangles(corners):
    """Return a regular polygon in the middle of a square, surrounded by triangles."""
    angle = 2 * np.pi * np.arange(corners) / corners
    ring = 0.5 + 0.4 * np.column_stack([np.cos(angle), np.sin(angle)])
    box = [(1.0, 1.0), (0.0, 1.0), (0.0, 0.0), (1.0, 0.0)]
    spokes = [[(k + 1) % corners, k, corners + 4 * k // corners] for k in range(corners)]
    sides = [[side * corners // 4, corners + (side - 1) % 4, corners + side] for side in range(4)]
    return np.vstack([ring, box]), [list(range(corners)), *spokes, *sides]


def squash(aspect):
    """Return seven rows of needles along the floor, with an aspect ratio near `aspect`, and a row of tall cells."""
    nx, ny = 8, 8
    heights = np.concatenate([np.linspace(0, 0.125 * ny / aspect, ny), [1.0]])
    points = np.array([(x, y) for y in heights for x in np.linspace(0, 1, nx + 1)])
    first = (np.arange(ny)[:, None] * (nx + 1) + np.arange(nx)).ravel()
    return points, first[:, None] + [0, 1, nx + 2, nx + 1]


def add_flat_angles(n, more):
    """Return squares with `more` additional vertices on every edge."""
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


def move(points, cells, offset):
    return shear_block(vx.PolygonMesh(points * [2.0, 0.5] + offset, cells), origin=(offset, offset))


def cells_of(mesh):
    return mesh.points, mesh.cells


def renumber():
    mesh = vx.meshes.voronoi(6)
    random = np.random.default_rng(3)
    order = random.permutation(mesh.n_nodes)
    cells = [np.roll(order[cell], k) for k, cell in enumerate(mesh.cells)]
    return mesh.points[np.argsort(order)], [cells[c] for c in random.permutation(mesh.n_cells)]


def make_clockwise(which):
    mesh = vx.meshes.voronoi(5)
    return mesh.points, [cell[::-1] if which(c) else cell for c, cell in enumerate(mesh.cells)]


def mirror():
    mesh = vx.meshes.voronoi(6)
    return (mesh.points * [-1, 1] + [1, 0]), [cell[::-1] for cell in mesh.cells]


def sound_case(name, points_and_cells, **more):
    return Case(name, lambda: shear_block(fit_box(*points_and_cells())), **more)


CASES = (
    *(
        sound_case(f"edges of {part:.0e} h", lambda part=part: split_nodes(6, part))
        for part in (1e-3, 1e-6, 1e-9, 1e-12)
    ),
    Case("hanging nodes", lambda: shear_block(vx.meshes.hanging(8, box=((0, 2), (0, 0.5))))),
    sound_case("20 flat angles an edge", lambda: add_flat_angles(4, 20)),
    Case("non-convex cells", lambda: shear_block(vx.meshes.nonconvex(8, box=((0, 2), (0, 0.5))))),
    sound_case("two combs", lambda: draw_cells(*COMB)),
    sound_case("two spirals, centroids outside", lambda: draw_cells(*SPIRAL)),
    sound_case("an L and a square", lambda: draw_cells("ab", "aa")),
    sound_case("a U and the cell that fills it", lambda: draw_cells("aba", "aba", "aaa")),
    *(sound_case(f"aspect ratio {aspect:.0e}", lambda aspect=aspect: squash(aspect)) for aspect in (1e2, 1e4, 1e6)),
    sound_case("a 500-gon among triangles", lambda: polygon_among_triangles(500)),
    sound_case("a single cell", lambda: ([(0, 0), (1, 0), (1, 1), (0, 1)], [[0, 1, 2, 3]])),
    sound_case("a single cell of 200 vertices", lambda: add_flat_angles(1, 49)),
    sound_case("all cells clockwise", lambda: make_clockwise(lambda c: True), must=WARNING, says="listed clockwise"),
    sound_case("mixed orientation", lambda: make_clockwise(lambda c: c % 2), must=WARNING, says="listed clockwise"),
    Case("coordinates offset by 1e6", lambda: move(*cells_of(vx.meshes.voronoi(6)), 1e6)),
    sound_case("renumbered", renumber),
    sound_case("mirrored", mirror),
)
