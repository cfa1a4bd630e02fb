"""What holds for every mesh, material, load and bound: one function a property, examples by hypothesis."""
