"""Is what a user hands in a valid mesh? Checks of cells, of the tiling, of names and data."""
