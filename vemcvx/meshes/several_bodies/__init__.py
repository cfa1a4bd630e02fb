"""Several bodies in one mesh: where their boundaries coincide, nodes of the other as hanging vertices, names."""
