"""The stand-in's path-traced camera: episodes of the environment as a real-looking camera would have seen them."""
