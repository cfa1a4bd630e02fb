"""Properties of every mesh, material, load and bound: one function per property, with examples by hypothesis."""
