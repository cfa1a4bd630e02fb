"""Families of meshes of a box, one a file, and an L."""
