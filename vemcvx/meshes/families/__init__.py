"""Families of meshes of boxes, an L and rings."""
