"""Pictures of a history: each a function that returns a matplotlib figure, or draws on axes that it is given."""

from vemcvx.plots.animation import animate
from vemcvx.plots.body_in_plane import deformed_mesh, stressed_body
from vemcvx.plots.body_in_space import deformed_body
from vemcvx.plots.contact_in_plane import friction_traction, stick_slip_map, wear
from vemcvx.plots.contact_in_space import contact_face, friction_disc
from vemcvx.plots.pictures import energy_ledger, write_plots

__all__ = [
    "animate",
    "contact_face",
    "deformed_body",
    "deformed_mesh",
    "energy_ledger",
    "friction_disc",
    "friction_traction",
    "stick_slip_map",
    "stressed_body",
    "wear",
    "write_plots",
]
