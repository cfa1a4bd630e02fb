"""Pictures of a history: each a function that returns a matplotlib figure, or draws on axes that it is given."""

from vemcvx.plots.animation import animate
from vemcvx.plots.contact_face import contact_face
from vemcvx.plots.deformed_body import deformed_body
from vemcvx.plots.deformed_mesh import deformed_mesh
from vemcvx.plots.energy_ledger import energy_ledger
from vemcvx.plots.friction_disc import friction_disc
from vemcvx.plots.friction_traction import friction_traction
from vemcvx.plots.pictures import write_plots
from vemcvx.plots.stick_slip_map import stick_slip_map
from vemcvx.plots.stressed_body import stressed_body
from vemcvx.plots.wear import wear

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
