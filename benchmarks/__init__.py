"""Benchmarks: the tables of the README; `python -m benchmarks` lists them and runs one by name."""

from benchmarks.common import pin_threads

pin_threads()  # before NumPy is loaded, so that results do not depend on the number of cores
