"""Pictures of a history: each a function that returns a matplotlib figure."""

from vemcvx.plots.deformed_mesh import deformed_mesh
from vemcvx.plots.energy_ledger import energy_ledger
from vemcvx.plots.friction_traction import friction_traction
from vemcvx.plots.pictures import write_plots
from vemcvx.plots.stick_slip_map import stick_slip_map

__all__ = ["deformed_mesh", "energy_ledger", "friction_traction", "stick_slip_map", "write_plots"]
