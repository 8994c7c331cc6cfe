"""Benchmarks: the tables of the README; `python -m benchmarks` lists them and runs one by name."""

import os

# Before NumPy is loaded: one thread for BLAS and Numba, so that results do not depend on the machine.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
