"""The stored steps for ParaView and PyVista: one VTU file a step, and a PVD file that lists them in time.

At nodes: displacement, and of contact slip, traction, bound, backward, pressure and wear, zero elsewhere; sticking and
closed, 1 or 0, are NaN elsewhere, so that what slips differs from what is not in contact.
On cells: stress (xx, yy, xy), principal_stresses, out_of_plane_stress (zz), von_mises and strain_energy, the density
1/2 eps : C eps, all of Pi u; stresses include what is there at zero strain. (What needs a zz that no material says is
left out.)
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from vemcvx.arrays import Floats
from vemcvx.meshes.io.files import write_cells
from vemcvx.results.results import Results
from vemcvx.vem import Space, equivalent, principal, strains, stresses

Fields = dict[str, Floats]


def write_series(history: Results, path: Path) -> None:
    """Write the PVD file `path` and the steps beside it."""
    root = ET.Element("VTKFile", type="Collection", version="0.1", byte_order="LittleEndian")
    collection = ET.SubElement(root, "Collection")
    digits = max(4, len(str(history.steps)))
    for row, step in enumerate(history.stored):
        name = f"step_{step:0{digits}d}.vtu"
        write_cells(path.with_name(name), history.mesh, at_nodes(history, row), on_cells(history, row))
        ET.SubElement(collection, "DataSet", timestep=repr(float(history.times[row])), part="0", file=name)
    ET.indent(root)
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def listed_steps(path: Path) -> set[str]:
    """Names of the step files that the PVD file `path` lists, if it is there and ours."""
    try:
        listed = [str(item.get("file")) for item in ET.parse(path).iter("DataSet")]
    except (OSError, ET.ParseError):
        return set()
    return {name for name in listed if name.startswith("step_") and name == Path(name).name}


def at_nodes(history: Results, row: int) -> Fields:
    """Displacement, and contact as fields of the whole body."""
    contact, u = history.contact, history.displacement[row]
    fields = {"displacement": u}
    for name in ("slip", "traction", "bound", "backward", "pressure", "sticking", "closed", "wear"):
        values = getattr(contact, name)[row]
        fields[name] = np.full((len(u), *values.shape[1:]), np.nan if values.dtype == bool else 0.0)
        fields[name][contact.nodes] = values
    return fields


def on_cells(history: Results, row: int) -> Fields:
    """Stresses and strain energy per area."""
    strain = strains(Space(history.mesh), history.displacement[row])
    elastic = stresses(history.moduli, strain)
    energy = 0.5 * np.einsum("ci,ci->c", elastic, strain)
    stress = history.stress(int(history.stored[row]))
    fields = {"stress": stress, "principal_stresses": principal(stress), "strain_energy": energy}
    if history.out_of_plane is not None:
        out_of_plane = history.out_of_plane_stress(int(history.stored[row]))
        fields |= {"out_of_plane_stress": out_of_plane, "von_mises": equivalent(stress, out_of_plane)}
    return fields
