"""Parts of `benchmarks.fuzz`: valid seeds, their mutations, targets that read them, and one case in its own process."""
