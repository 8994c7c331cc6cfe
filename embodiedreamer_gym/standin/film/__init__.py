"""Path-traced films of the tasks: episodes rendered by Blender's Cycles, with the noise and distortion of a camera."""
