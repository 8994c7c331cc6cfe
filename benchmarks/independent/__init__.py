"""Cases with hidden effects from a second, independent generator: own arms, motions and laws, all in MuJoCo.

Nothing here imports the package's stand-in robot, effects, simulation or motions (a test checks this). The laws are
written from textbooks, so they agree with the catalogue's laws only where the physics does. `cases.draw` makes a case;
`python -m benchmarks.diagnosis --set independent` and `--set independent_teleoperation` use them.
"""
