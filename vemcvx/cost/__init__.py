"""Sweeps, which measure true errors, seconds, unknowns and memory for many settings of a problem; parameter studies."""
