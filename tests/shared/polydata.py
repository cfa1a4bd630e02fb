"""A file with polyhedra in the format of ParaView and PyVista since VTK 9.4."""

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
