"""Benchmarks: the tables of the README; `python -m benchmarks` lists them and runs one by name."""
