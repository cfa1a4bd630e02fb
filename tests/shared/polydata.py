"""A file with polyhedra in the format of ParaView and PyVista since VTK 9.4."""

from pathlib import Path

POLYHEDRA = Path(__file__).with_name("polyhedra.vtu").read_text()
