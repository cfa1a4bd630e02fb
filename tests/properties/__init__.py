"""Properties of every mesh, material, load and bound: one function per property, tested on random examples."""
