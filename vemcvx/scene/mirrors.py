"""Curves of contact that end on a plane of symmetry: they go on behind it as their mirror image.

A plane of symmetry is a side of the body whose nodes are all held across it at all times: by Symmetry, by rollers, by
displacements of zero. The effects of contact are asked once more when it is known what supports hold, so that nodes
there get the normals that they have in the whole body. With those of their last facets, nodes at the ends of a quarter
of a press fit had a friction of .30 of the pressure, whatever the mesh width; the whole ring has none.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from vemcvx.arrays import Floats, Ints, read_only
from vemcvx.effects import Contribution, Effect
from vemcvx.scene.jumps import Jumps
from vemcvx.scene.supports import STRAIGHT
from vemcvx.vem import MirrorPlanes, Space


def contributions(effects: Iterable[Effect], space: Space) -> list[tuple[Effect, Contribution]]:
    """The effects, each with what it contributes."""
    parts = [(effect, effect.contribute(space)) for effect in effects]
    mirrors = _mirrors([part for _, part in parts], space)
    if mirrors is None:
        return parts
    mirrored = replace(space, mirrors=mirrors)
    return [(effect, effect.contribute(mirrored) if len(_contact(part)) else part) for effect, part in parts]


def _contact(part: Contribution) -> Jumps:
    """Where what an effect contributes is contact."""
    bilateral = [support for support in part.supports if support.contact]
    return Jumps.of([*part.frictions, *part.obstacles, *part.surfaces, *bilateral])


def _mirrors(parts: list[Contribution], space: Space) -> MirrorPlanes | None:
    """The planes of symmetry at nodes of contact; None where supports hold none of these, or all of them altogether."""
    still = [s for part in parts for s in part.supports if s.value is None and not s.contact]
    contact = [jumps for part in parts if len(jumps := _contact(part))]
    if not still or not contact:
        return None
    touching = np.unique(np.concatenate([np.append(jumps.nodes, jumps.partners) for jumps in contact]))
    held = _spans(np.concatenate([s.nodes for s in still]), np.concatenate([s.directions for s in still]))
    altogether = np.trace(held.projections, axis1=1, axis2=2) > space.dim - 0.5
    if not np.isin(held.nodes[~altogether], touching).any():
        return None
    # A node that is held altogether is on planes of all directions: so is a rigid partner.
    nodes = [np.repeat(held.nodes[altogether], space.dim)]
    normals = [np.tile(np.eye(space.dim), (int(altogether.sum()), 1))]
    for of_side, normal in _sides_held_across(space, held):
        nodes.append(of_side.ravel())
        normals.append(np.repeat(normal, of_side.shape[1], axis=0))
    of_nodes, across = np.concatenate(nodes), np.concatenate(normals)
    here = np.isin(of_nodes, touching)
    return _spans(of_nodes[here], across[here])


def _sides_held_across(space: Space, held: MirrorPlanes) -> list[tuple[Ints, Floats]]:
    """Sides whose nodes cannot leave their planes: the nodes (m, n) and normals (m, dim) of those with equally many."""
    part, place = space.part("boundary", "symmetry", contact=True), np.full(space.mesh.n_nodes, -1)
    place[held.nodes] = np.arange(len(held.nodes))
    found = []
    for rule in part.rules(1):
        sides = np.flatnonzero((place[rule.nodes] >= 0).all(axis=1))
        nodes, normals = rule.nodes[sides], part.normals[rule.sides[sides]]
        along = np.einsum("snij,sj->sni", held.projections[place[nodes]], normals)
        across = (np.linalg.norm(along - normals[:, None, :], axis=2) <= STRAIGHT).all(axis=1)
        found.append((nodes[across], normals[across]))
    return found


def _spans(nodes: Ints, directions: Floats) -> MirrorPlanes:
    """Of each node the projection on its directions."""
    each, place = np.unique(nodes, return_inverse=True)
    squares = np.zeros((len(each), directions.shape[1], directions.shape[1]))
    np.add.at(squares, place, np.einsum("ki,kj->kij", directions, directions))
    # Of two directions at the angle a the squares are 1 -+ cos a along their bisectors: by a^2 / 2 they are two.
    sizes, axes = np.linalg.eigh(squares)
    axes = axes * (sizes > 0.5 * STRAIGHT**2)[:, None, :]
    return MirrorPlanes(read_only(each), read_only(axes @ axes.swapaxes(1, 2)))
