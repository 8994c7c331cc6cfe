"""Hidden-effect cases of a second, independent generator: own arms, own motions, own laws, all in MuJoCo.

Nothing here imports the package's stand-in robot, its effects, its simulation or its motions (a test says so). The laws are
written from textbooks, so they agree with the catalogue's only as far as the physics does. `cases.draw` makes a case;
`python -m benchmarks.diagnosis --set independent` and `--set independent_teleoperation` ask them.
"""
