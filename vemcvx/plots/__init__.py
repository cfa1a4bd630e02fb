"""Pictures of a history: each a function that returns a matplotlib figure, or draws on axes that it is given."""

from vemcvx.plots.body import deformed_body, deformed_mesh, stressed_body
from vemcvx.plots.contact import along_contact, friction_traction, stick_slip_map, wear
from vemcvx.plots.faces import contact_face, friction_disc
from vemcvx.plots.pictures import animate, energy_ledger, error_map, hysteresis_loop, write_plots

__all__ = [
    "along_contact",
    "animate",
    "contact_face",
    "deformed_body",
    "deformed_mesh",
    "energy_ledger",
    "error_map",
    "friction_disc",
    "friction_traction",
    "hysteresis_loop",
    "stick_slip_map",
    "stressed_body",
    "wear",
    "write_plots",
]
