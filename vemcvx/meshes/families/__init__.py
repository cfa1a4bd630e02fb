"""Families of meshes: boxes, L-shaped domains, rings and discs."""
