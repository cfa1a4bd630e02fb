"""Colours by what they mean, apart for colour-blind eyes (after Okabe and Ito) and, as areas, in grey print."""

STICK, SLIP = "#0072B2", "#D55E00"
STICK_AREA, FORWARD, BACKWARD = "#B3D7EE", "#D55E00", "#3B1C6B"
"""Areas: light, middle, dark; slip towards larger and towards smaller positions."""
SLIP_AREA, OPEN_AREA = "#F6CDB0", "#EDEDED"
WORK, STORED, DISSIPATED, NUMERICAL = "#000000", "#0072B2", "#D55E00", "#009E73"
OUTLINE = "0.45"
COMPUTED, EXACT = "#0072B2", "#000000"
SECOND, THIRD = "#D55E00", "#009E73"
"""Marks of what was computed, the line of a closed form, and further curves beside these."""
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#3B1C6B", "#000000")
MARKERS = "osD^vPX*"
"""Many series: colours, and marks for print without them."""
PUSH = "0.2"
SIGNED, TENSION, COMPRESSION, SIZE = "RdBu_r", "Reds", "Blues_r", "viridis"
"""Colour maps: tension red and compression blue, both or one; and of what has no sign."""
EARLY_TO_LATE = ("#D8D8D8", "#9FC9E2", "#0072B2", "#3B1C6B")
"""Curves of ever later instants: ever darker."""
