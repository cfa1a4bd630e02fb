"""Pressure and friction recovered from the forces on nodes of contact, in the plane.

Forces on nodes are right in the mean over a few sides, R(v) = int p v for smooth v, better than each of them is. A
force over int phi_i, as `Contact.pressure` has it, is p not at node i but where phi_i has its centre, (h_2 - h_1) / 3
away from it between sides of lengths h_1, h_2; and where nodes of two bodies alternate, forces do, too, because a
hanging node bends a cell in which strains are constant. Both are of order h, and show as a ripple. The recovered
pressure is linear along sides, p = sum_i p_i phi_i, has these forces in the mean, and is smooth: it is least in

    1/2 int p^2 - sum_i R_i p_i + 1/2 c sum_i h_i^4 / l_i [p']_i^2,    hence    (M + c J' diag(h^4 / l) J) p = R,

with the jumps [p']_i = (J p)_i of its slope at nodes between two sides, l_i half their length, M = int phi_i phi_j.
The last term is c h^4 int p''^2 of a smoothing spline (Reinsch, Numer. Math. 10 (1967)); without it p is the
L2-projection of the forces, as consistent fluxes are (Carey, Chow and Seager, Comput. Methods Appl. Mech. Engrg. 50
(1985)), and ripples by twice as much. Tested by 1 and x, for which J vanishes: the resultant of every stretch and its
moment are kept, and what is constant or linear is found exactly. Of a wave of length L remains the part
1 / (1 + c (2 pi h / L)^4), so that smooth fields are changed by the order of h^4.

A stretch is what is closed in one piece, without corners: p ends with it, and half a side beyond its last node, where
no phi_i goes on, counts as p_i phi_i. Where all forces press, so does p: what is negative is 0, and the rest is scaled
to the resultant. At corners, and at nodes alone, p is R_i / int phi_i.

With the moments J p for unknowns of their own, sides of a millionth of others cost six digits and not eighteen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from vemcvx.arrays import Bools, Floats, Ints, summed_columns
from vemcvx.meshes import PolygonMesh
from vemcvx.meshes.polygons import smallest_linked
from vemcvx.scene.contact import Surface
from vemcvx.scene.contact_table import ContactRows, pair_numbers
from vemcvx.vem.boundary import SMOOTH

ROUGHNESS = 0.5
"""c: of ripples of two sides 2 % are left, of four 25 %. From .04 to 2.6 measured on flat joints, press fits, Hertz'
contact and under a punch: more rounds the edge of contact, less leaves more of triangles' ripple."""


@dataclass(frozen=True, eq=False)
class ContactSides:
    """The sides of contact in the plane between two of its m nodes, without those at corners."""

    ends: Ints
    """(k, 2) the nodes, of m"""
    lengths: Floats
    """(k,)"""
    reach: Floats
    """(k,) h, the length of the side of the finer of the two bodies that each is part of"""

    @classmethod
    def of(cls, rows: ContactRows, at: Ints, surface: Surface, mesh: PolygonMesh) -> ContactSides:
        """The sides of these rows, whose places among the nodes of contact are `at`."""
        each, (node, beyond) = rows.ends.tocoo(), rows.names.T
        owner = np.full(len(node), -1)
        owner[each.col] = at[each.row]
        one, back = (pair_numbers(*pair, mesh.n_nodes) for pair in ((node, beyond), (beyond, node)))
        other = np.minimum(np.searchsorted(one, back), len(one) - 1)
        whole = np.flatnonzero((one[other] == back) & (node < beyond) & (owner >= 0) & (owner[other] >= 0))
        ends, m = np.column_stack([owner[whole], owner[other[whole]]]), len(surface)
        along = mesh.points[beyond[whole]] - mesh.points[node[whole]]
        lengths = np.linalg.norm(along, axis=1)
        turn = np.linalg.norm(_differences(ends, m).T @ (along / lengths[:, None]), axis=1)
        degree = np.bincount(ends.ravel(), minlength=m)
        corner = (degree > 2) | ((degree == 2) & (turn > SMOOTH))
        kept = ~corner[ends].any(axis=1)
        ends, lengths, reach = ends[kept], lengths[kept], np.full(int(kept.sum()), np.inf)
        cells = np.bincount(mesh.vertices, minlength=mesh.n_nodes)
        for body in (surface.nodes, surface.partners):
            reach = np.minimum(reach, _runs(ends, lengths, (body >= 0) & (cells[body] == 1)))
        return cls(ends, lengths, reach)


def _differences(ends: Ints, m: int) -> sp.csr_matrix:
    """(k, m) the differences of values at the ends of sides."""
    signs = np.tile([-1.0, 1.0], len(ends))
    return sp.csr_matrix((signs, ends.ravel(), np.arange(0, ends.size + 1, 2)), shape=(len(ends), m))


def _runs(ends: Ints, lengths: Floats, hangs: Bools) -> Floats:
    """The lengths (k,) of what sides were before the nodes that hang, of m, were put into them."""
    order = np.argsort(ends.ravel(), kind="stable")
    node = ends.ravel()[order]
    same = np.flatnonzero((np.diff(node) == 0) & hangs[node[:-1]])
    run = smallest_linked(np.column_stack([order[same], order[same + 1]]) // 2, len(ends))
    before: Floats = np.bincount(run, lengths, minlength=len(ends)).astype(float)[run]
    return before


def recovered(forces: Floats, lengths: Floats, sides: ContactSides, closed: Bools, *, presses: bool) -> Floats:
    """Forces (S, m) on nodes as recovered forces per length.

    Parameters
    ----------
    forces : (S, m) array
    lengths : (m,) array
        int phi_i, positive.
    sides : ContactSides
    closed : (S, m) bool array
        The nodes to which stretches go, at each instant.
    presses : bool
        Whether a stretch with no negative forces has no negative values.
    """
    found = forces / lengths
    patterns, of = np.unique(closed, axis=0, return_inverse=True)
    for number, pattern in enumerate(patterns):
        rows = np.flatnonzero(of.ravel() == number)
        kept = pattern[sides.ends].all(axis=1)
        if kept.any():
            stretch = ContactSides(sides.ends[kept], sides.lengths[kept], sides.reach[kept])
            smooth = _smoothed(forces[rows], lengths, stretch)
            found[rows] = _pressing(smooth, forces[rows], lengths, stretch) if presses else smooth
    return found


def _smoothed(forces: Floats, lengths: Floats, sides: ContactSides) -> Floats:
    """The field (S, m) without regard to signs, R_i / int phi_i where no side is."""
    m, ends, h = len(lengths), sides.ends, sides.lengths
    differences = _differences(ends, m)
    shared = sp.csr_matrix((np.tile(h / 6.0, 2), (ends.T.ravel(), ends[:, ::-1].T.ravel())), shape=(m, m))
    mass = shared + sp.diags_array(lengths - np.asarray(shared.sum(axis=1)).ravel())
    inner = np.flatnonzero(np.bincount(ends.ravel(), minlength=m) == 2)
    around, reach = sp.csr_matrix(abs(differences.T))[inner], np.zeros(m)
    np.maximum.at(reach, ends, sides.reach[:, None])
    # Rows of J times l_1 l_2 / (l_1 + l_2), and h, so that none is large.
    scale = reach[inner] / (around @ (1.0 / h))
    J = sp.diags_array(scale) @ sp.csr_matrix(differences.T @ sp.diags_array(1.0 / h) @ differences)[inner]
    soft = sp.diags_array(0.5 * (around @ h) * (scale / reach[inner] ** 2) ** 2 / ROUGHNESS)
    system = sp.csc_matrix(sp.vstack([sp.hstack([mass, J.T]), sp.hstack([J, -soft])]))
    loads = np.concatenate([forces.T, np.zeros((len(inner), len(forces)))])
    smooth: Floats = splu(system).solve(loads)[:m].T
    return smooth


def _pressing(smooth: Floats, forces: Floats, lengths: Floats, sides: ContactSides) -> Floats:
    """The field without negative values in stretches that are pressed all over, with the same resultants."""
    m = len(lengths)
    stretch = smallest_linked(sides.ends, m)
    pulled, turned = (summed_columns((each < 0).astype(float), stretch, m)[:, stretch] > 0 for each in (forces, smooth))
    positive = np.maximum(smooth, 0.0)
    total, wanted = (summed_columns(each, stretch, m)[:, stretch] for each in (positive * lengths, forces))
    scaled = positive * np.divide(wanted, total, out=np.ones_like(total), where=total > 0)
    return np.where(turned & ~pulled, scaled, smooth)
