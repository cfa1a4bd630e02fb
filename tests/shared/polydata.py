"""Files of polygons alone as VTK writes them, with a datum "young's modulus" of double and one "kind" of int cells."""

from __future__ import annotations

import numpy as np


def data(mesh):
    return np.linspace(1.0, 2.0, mesh.n_cells), np.arange(mesh.n_cells, dtype=np.int32)


def legacy(mesh, version, binary=True):
    """A .vtk of version "4.2" or "5.1"."""

    def numbers(values, kind):
        values = np.asarray(values).ravel()
        return values.astype(kind).tobytes() if binary else " ".join(map(repr, values.tolist())).encode()

    points, (young, kind) = np.pad(mesh.points, ((0, 0), (0, 1))), data(mesh)
    if version == "5.1":
        polygons = [
            b"POLYGONS %d %d\nOFFSETS vtktypeint64" % (len(mesh.offsets), len(mesh.vertices)),
            numbers(mesh.offsets, ">i8"),
            b"CONNECTIVITY vtktypeint64",
            numbers(mesh.vertices, ">i8"),
        ]
    else:
        cells = np.insert(mesh.vertices, mesh.offsets[:-1], np.diff(mesh.offsets))
        polygons = [b"POLYGONS %d %d" % (mesh.n_cells, len(cells)), numbers(cells, ">i4")]
    lines = [
        b"# vtk DataFile Version " + version.encode(),
        b"vtk output",
        b"BINARY" if binary else b"ASCII",
        b"DATASET POLYDATA",
        b"POINTS %d double" % mesh.n_nodes,
        numbers(points, ">f8"),
        b"METADATA\nINFORMATION 0\n",
        *polygons,
        b"\nCELL_DATA %d\nSCALARS young's%%20modulus double\nLOOKUP_TABLE default" % mesh.n_cells,
        numbers(young, ">f8"),
        b"FIELD FieldData 1\nkind 1 %d int" % mesh.n_cells,
        numbers(kind, ">i4"),
    ]
    return b"\n".join(lines) + b"\n"


def xml(mesh, appended=False):
    """A .vtp, its numbers in place or, raw, at the end."""
    young, kind = data(mesh)
    blob = b""

    def array(kind, name, values, more=""):
        nonlocal blob
        head = f'<DataArray type="{kind}" Name="{name}" {more}'
        if not appended:
            return f'{head} format="ascii">\n{" ".join(map(repr, np.asarray(values).ravel().tolist()))}\n</DataArray>'
        at, raw = len(blob), np.ascontiguousarray(values, dtype=kind.lower()).tobytes()
        blob += np.uint64(len(raw)).tobytes() + raw
        return f'{head} format="appended" offset="{at}"/>'

    def cells(name, offsets, vertices):
        arrays = array("Int64", "connectivity", vertices), array("Int64", "offsets", offsets)
        return [f"<{name}>", *arrays, f"</{name}>"]

    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        "<PolyData>",
        f'<Piece NumberOfPoints="{mesh.n_nodes}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" '
        f'NumberOfPolys="{mesh.n_cells}">',
        '<CellData Scalars="kind">',
        array("Float64", "young's modulus", young),
        array("Int32", "kind", kind),
        "</CellData>",
        "<Points>",
        array("Float64", "Points", np.pad(mesh.points, ((0, 0), (0, 1))), 'NumberOfComponents="3"'),
        "</Points>",
        *(line for name in ("Verts", "Lines", "Strips") for line in cells(name, [], [])),
        *cells("Polys", mesh.offsets[1:], mesh.vertices),
        "</Piece>",
        "</PolyData>",
    ]
    text = "\n".join(lines).encode()
    if appended:
        text += b'\n<AppendedData encoding="raw">\n_' + blob + b"\n</AppendedData>"
    return text + b"</VTKFile>"


POLYHEDRA = """<?xml version="1.0"?>
<VTKFile type="UnstructuredGrid" version="2.3" byte_order="LittleEndian" header_type="UInt32">
  <UnstructuredGrid>
    <FieldData>
      <Array type="String" Name="words" NumberOfTuples="1" format="ascii">97 98 0</Array>
    </FieldData>
    <Piece NumberOfPoints="12" NumberOfCells="3">
      <PointData></PointData>
      <CellData>
        <DataArray type="Float64" Name="young" format="ascii">1 2 7</DataArray>
        <DataArray type="UInt8" Name="boundary:floor" format="ascii">0 0 1</DataArray>
      </CellData>
      <Points>
        <DataArray type="Float64" Name="Points" NumberOfComponents="3" format="ascii">
          0 0 0 1 0 0 0 1 0 1 1 0 0 0 1 1 0 1 0 1 1 1 1 1 3 0 0 3 1 0 3 0 1 3 1 1
        </DataArray>
      </Points>
      <Cells>
        <DataArray type="Int64" Name="connectivity" format="ascii">
          0 1 2 3 4 5 6 7 1 8 9 3 5 10 11 7 0 1 3 2
        </DataArray>
        <DataArray type="Int64" Name="offsets" format="ascii">8 16 20</DataArray>
        <DataArray type="UInt8" Name="types" format="ascii">42 12 9</DataArray>
        <DataArray type="Int64" Name="face_connectivity" format="ascii">
          0 4 6 2 1 3 7 5 0 1 5 4 2 6 7 3 0 2 3 1 4 5 7 6
        </DataArray>
        <DataArray type="Int64" Name="face_offsets" format="ascii">4 8 12 16 20 24</DataArray>
        <DataArray type="Int64" Name="polyhedron_to_faces" format="ascii">0 1 2 3 4 5</DataArray>
        <DataArray type="Int64" Name="polyhedron_offsets" format="ascii">6 6 6</DataArray>
      </Cells>
    </Piece>
  </UnstructuredGrid>
</VTKFile>
"""
