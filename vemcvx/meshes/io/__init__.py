"""Meshes from and to files and the objects of other libraries."""
