"""The parts of `benchmarks.fuzz`: valid seeds, mutations of them, what reads them, and one case in a process of its own."""
