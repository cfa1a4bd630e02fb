"""Results of a simulation: fields, contact, probes, tables, files."""

from vemcvx.results.arc import ALONG, contact_path
from vemcvx.results.contact import Contact
from vemcvx.results.corners import Corners
from vemcvx.results.forces import largest
from vemcvx.results.loops import loop_of
from vemcvx.results.probe import places
from vemcvx.results.quoted import SINGULAR, Quantity, growth
from vemcvx.results.results import (
    Results,
    displacement,
    largest_values,
    last_of_largest,
    programs_of_steps,
    record,
    warn_of_large_strains,
)

__all__ = [
    "ALONG",
    "SINGULAR",
    "Contact",
    "Corners",
    "Quantity",
    "Results",
    "contact_path",
    "displacement",
    "growth",
    "largest",
    "largest_values",
    "last_of_largest",
    "loop_of",
    "places",
    "programs_of_steps",
    "record",
    "warn_of_large_strains",
]
