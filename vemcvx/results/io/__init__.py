"""Results in a folder: a series for ParaView, a summary for scripts, and everything, to the bit, for us."""
