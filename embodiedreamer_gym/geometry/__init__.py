"""Cameras, rotations and meshes: geometry that is independent of robots."""
