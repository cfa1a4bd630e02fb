"""Writing and converting meshes: methods that those of plane and space share."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from vemcvx.meshes.io.files import write
from vemcvx.meshes.io.objects import to_object


class Exported:
    """A mesh that goes into files and other libraries, and comes back from them."""

    def write(self: Any, path: str | Path) -> None:
        """Write the mesh, its named boundaries and cell data; `read` gives them back to the bit, in space from .vtu.

        Parameters
        ----------
        path : str or Path
            The suffix chooses the format. Every mesh goes into .vtu files (polyhedra as VTK has them, their boundaries
            as polygons), every plane one into .vtk, too. Files of Gmsh (.msh), Abaqus (.inp) and Nastran (.bdf, .nas,
            .fem) take triangles and quads; in space tetrahedra, hexahedra, wedges and, but for Abaqus, pyramids.

        Raises
        ------
        MeshError
            The format would lose cells, or the file cannot be written.
        """
        write(path, self)

    def to(self: Any, library: Literal["meshio", "skfem", "pyvista"]) -> Any:
        """Return the mesh as an object of another library; :func:`vemcvx.meshes.convert` is the way back.

        Parameters
        ----------
        library : {"meshio", "skfem", "pyvista"}
            Its name. Points keep their order in all of them.

        Returns
        -------
        meshio.Mesh
            As `write` puts it into a .vtu file: polygons in blocks of one vertex count; in space tetrahedra,
            hexahedra, wedges and pyramids in blocks of one kind. Blocks of lines (triangles or quadrilaterals) follow,
            of which the cell datum "boundary:<name>" marks those of a named boundary. If this permutes cells, the datum
            "vemcvx:cell" has their numbers.
        skfem.MeshTri, MeshQuad, MeshTet or MeshHex
            With named boundaries; cell data of zeros and ones are subdomains.
        pyvista.UnstructuredGrid
            Cells in their order, with their data. A named boundary is the field datum "boundary:<name>": its edges
            (m, 2); in space the vertices of its faces, a row each, filled up with -1.

        Raises
        ------
        MeshError
            The library is none of these, or has no such cells (scikit-fem: cells of one kind alone).
        VemcvxError
            The library is not installed.

        Warns
        -----
        MeshWarning
            scikit-fem keeps no other cell data.
        """
        return to_object(self, library)
