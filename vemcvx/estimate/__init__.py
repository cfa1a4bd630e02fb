"""How far a run is from the truth: distances, estimates part by part, meshes and instants that meet a target."""
