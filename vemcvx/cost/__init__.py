"""Parameter studies, and sweeps that measure true errors, seconds, unknowns and memory for many settings."""
