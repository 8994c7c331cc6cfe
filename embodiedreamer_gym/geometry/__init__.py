"""Cameras, rotations, meshes: geometry that knows nothing of robots."""
