"""The episode that the tests of the bench replay."""

SEED, STEPS = 1, 170  # by then the expert has let go of the cup
