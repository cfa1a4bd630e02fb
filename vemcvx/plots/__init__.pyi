"""The pictures by module; each module is imported when one of its pictures is first used."""

from .body import deformed_body as deformed_body
from .body import deformed_mesh as deformed_mesh
from .body import stressed_body as stressed_body
from .contact import along_contact as along_contact
from .contact import friction_traction as friction_traction
from .contact import stick_slip_map as stick_slip_map
from .faces import contact_face as contact_face
from .pictures import animate as animate
from .pictures import energy_ledger as energy_ledger
from .pictures import forces_over_time as forces_over_time
from .pictures import hysteresis_loop as hysteresis_loop
from .pictures import write_plots as write_plots
