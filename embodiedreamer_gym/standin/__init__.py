"""The stand-in for a real robot: MuJoCo arms with hidden faults, for tests, benchmarks and the demo."""
