"""Colours by what they mean, apart for colour-blind eyes (after Okabe and Ito) and, as areas, in grey print."""

STICK, SLIP = "#0072B2", "#D55E00"
STICK_AREA, FORWARD, BACKWARD = "#B3D7EE", "#D55E00", "#3B1C6B"
"""Areas: light, middle, dark; slip towards larger and towards smaller positions."""
WORK, STORED, DISSIPATED, NUMERICAL = "#000000", "#0072B2", "#D55E00", "#009E73"
OUTLINE = "0.45"
GRID = {"color": "0.9", "linewidth": 0.6}
