"""VTU files: fields on a mesh; and polyhedra, every cell of type 42, faces outwards in their order, kept to the bit.

Named boundaries of polyhedra go along as polygons, marked by data (see `blocks`), which else have that of their cells.
"""

from __future__ import annotations

import base64
import sys
import zlib
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Ints
from vemcvx.errors import MeshError
from vemcvx.meshes.box import WHOLE
from vemcvx.meshes.io.blocks import MARK, cell_blocks, vtk_types
from vemcvx.meshes.io.meshio_mesh import Arrays, meshio_mesh, translated, xml_name
from vemcvx.meshes.io.solids import POLYHEDRON
from vemcvx.meshes.polygons.topology import offsets_of, rows_in_order
from vemcvx.meshes.polyhedra import Listed, listed_faces
from vemcvx.meshes.tessellation import SpaceTessellation, Tessellation


def write_cells(path: Path, mesh: Tessellation | SpaceTessellation, point_data: Arrays, cell_data: Arrays) -> None:
    """Write fields on a mesh as a VTU file that ParaView opens.

    Parameters
    ----------
    path : Path
        Must end in .vtu.
    mesh : PolygonMesh or PolyhedralMesh
        The cells; boundaries and cell data of the mesh are not written.
    point_data, cell_data : mapping of str to array
        One row a node, one row a cell; vectors of two components get a third, zero.

    Raises
    ------
    MeshError
        The suffix is another, a field has the wrong number of rows, or the file cannot be written.
    """
    if path.suffix != ".vtu":
        raise MeshError(f"{path}: fields are written as .vtu files; got the suffix {path.suffix!r}.")
    for kind, data, rows in (("point", point_data, mesh.n_nodes), ("cell", cell_data, mesh.n_cells)):
        for name, values in data.items():
            if np.ndim(values) not in (1, 2) or len(values) != rows:
                raise MeshError(f"{path}: {kind} field {name!r} needs {rows} rows; got shape {np.shape(values)}.")
    nodes, cells = ({name: _three(values) for name, values in given.items()} for given in (point_data, cell_data))
    with translated(str(path), "cannot be written"):
        if isinstance(mesh, SpaceTessellation):
            write_polyhedra(path, mesh, nodes, cells, sides=False)
        else:
            file = meshio_mesh(mesh.points, cell_blocks(mesh, cells), ".vtu")
            file.point_data = {xml_name(name): values for name, values in nodes.items()}
            file.write(path)


def _three(values: ArrayLike) -> NDArray[Any]:
    values = np.asarray(values)
    return np.pad(values, ((0, 0), (0, 1))) if values.ndim == 2 and values.shape[1] == 2 else values


def write_polyhedra(path: Path, mesh: SpaceTessellation, point_data: Arrays, cell_data: Arrays, *, sides: bool) -> None:
    """Write a mesh with data on nodes and cells, and with its named boundaries if ``sides``."""
    named = {name: faces for name, faces in mesh.boundaries.items() if name != WHOLE} if sides else {}
    outer = np.concatenate([np.empty(0, dtype=np.int64), *named.values()])
    owner = np.concatenate([np.arange(mesh.n_cells), mesh.face_cells[outer, 0]])
    data = {name: np.asarray(values)[owner] for name, values in cell_data.items()}
    place = np.repeat(np.arange(len(named)), [len(faces) for faces in named.values()])
    for number, name in enumerate(named):
        data[MARK + name] = np.concatenate([np.zeros(mesh.n_cells), place == number]).astype(np.uint8)
    root = ElementTree.Element("VTKFile", type="UnstructuredGrid", version="1.0", header_type="UInt64")
    root.set("byte_order", "LittleEndian" if sys.byteorder == "little" else "BigEndian")
    root.set("compressor", "vtkZLibDataCompressor")
    grid = ElementTree.SubElement(root, "UnstructuredGrid")
    sizes = {"NumberOfPoints": str(mesh.n_nodes), "NumberOfCells": str(len(owner))}
    piece = ElementTree.SubElement(grid, "Piece", sizes)
    _section(piece, "Points", {"Points": mesh.points})
    _section(piece, "Cells", _cells(mesh, outer))
    _section(piece, "PointData", point_data)
    _section(piece, "CellData", data)
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def face_stream(listed: Listed) -> tuple[Ints, Ints]:
    """VTK's face stream: of each cell the number of faces, of each face its number of nodes and these; and offsets."""
    sizes = np.diff(listed.offsets)
    stream = np.insert(listed.vertices, listed.offsets[:-1], sizes)
    starts = (listed.offsets + np.arange(len(listed.offsets)))[listed.cell_offsets]
    stream = np.insert(stream, starts[:-1], np.diff(listed.cell_offsets))
    return stream, starts[1:] + np.arange(1, len(starts))


def _cells(mesh: SpaceTessellation, outer: Ints) -> Arrays:
    own, nodes = mesh.cell_nodes
    rows, corners = rows_in_order(mesh.face_offsets, mesh.face_vertices, outer)
    stream, ends = face_stream(listed_faces(mesh.faces))
    types = np.concatenate([np.full(mesh.n_cells, POLYHEDRON), vtk_types(np.diff(rows))])
    return {
        "connectivity": np.concatenate([nodes, corners]),
        "offsets": offsets_of(np.concatenate([np.diff(own), np.diff(rows)]))[1:],
        "types": types.astype(np.uint8),
        "faces": stream,
        "faceoffsets": np.concatenate([ends, np.full(len(outer), -1)]),
    }


def _section(piece: ElementTree.Element, tag: str, arrays: Arrays) -> None:
    section = ElementTree.SubElement(piece, tag)
    for name, given in arrays.items():
        values = np.asarray(given)
        values = values.astype(np.uint8) if values.dtype == bool else values
        kind = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind] + str(8 * values.dtype.itemsize)
        array = ElementTree.SubElement(section, "DataArray", type=kind, Name=name, format="binary")
        if values.ndim > 1:
            array.set("NumberOfComponents", str(values[0].size if len(values) else values.shape[1]))
        array.text = _encoded(np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("=")).tobytes())


def _encoded(data: bytes) -> str:
    """One zlib block in base64, after the sizes that VTK expects."""
    packed = zlib.compress(data, 1)
    header = np.array([1, len(data), len(data), len(packed)] if data else [0, 0, 0], dtype=np.uint64)
    return base64.b64encode(header.tobytes()).decode() + (base64.b64encode(packed).decode() if data else "")
