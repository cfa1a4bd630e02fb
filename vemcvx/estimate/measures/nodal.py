"""The distance |u - I v|_{a^h} on the mesh of u, where all its nodes are nodes of the mesh of v.

I v takes the values of v at those nodes, and, cell by cell, with tau the smallest shear stiffness, 2 mu if isotropic,

    |w|^2 = sum_K |K| eps(Pi w) : C eps(Pi w) + tau sum_i |w(x_i) - Pi w(x_i)|^2,    (3.13).

It misses what v does between the coarse nodes, and so reads less than the distance of the functions.
"""

from __future__ import annotations

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import MeshError
from vemcvx.estimate.measures.field import Field
from vemcvx.estimate.measures.measured import Measured, measured
from vemcvx.meshes import PolygonMesh
from vemcvx.meshes.polygons.search import nearest
from vemcvx.vem import elastic_matrix, strains, stresses
from vemcvx.vem.anisotropic import softest_shear
from vemcvx.vem.stabilisation import missed_squares

# Nodes are the same if they are closer than this part of the smallest cell's diameter.
SAME_NODE = 1e-6


def nodal_distance(u: Field, v: Field) -> Measured:
    """|u - I v|_{a^h} on the mesh of u, relative to |I v|_{a^h}.

    Raises
    ------
    MeshError
        A node of the mesh of u is no node of the mesh of v.
    """
    at_nodes = v.displacement[nested_nodes(u.mesh, v.mesh)]
    return measured(
        cell_energies(u, u.displacement - at_nodes), float(cell_energies(u, at_nodes).sum()), moduli_apart=0.0
    )


def nested_nodes(coarse: PolygonMesh, fine: PolygonMesh) -> Ints:
    """The node of the fine mesh at every node of the coarse one, (n_nodes,)."""
    if coarse is fine:
        return np.arange(coarse.n_nodes)
    away, node = nearest(fine.points, coarse.points)
    worst = int(np.argmax(away))
    if away[worst] > SAME_NODE * min(coarse.diameters.min(), fine.diameters.min()):
        raise MeshError(
            f"energy_distance: node {worst} of the first mesh, at {coarse.points[worst]}, is no node of the second: "
            f"the nearest is {away[worst]:.3g} away. The nodal distance wants the coarse run first and a nested fine "
            "one as reference; kind='projected' takes any two meshes."
        )
    return node


def cell_energies(field: Field, w: Floats) -> Floats:
    """a_K^h(w, w) of nodal displacements w (n_nodes, 2), with the moduli of a field, cell by cell: (n_cells,)."""
    strain = strains(field.space, w)
    energy: Floats = field.mesh.areas * np.sum(strain * stresses(field.moduli, strain), axis=1)
    return energy + softest_shear(elastic_matrix(field.moduli)) * missed_squares(field.space, w)
