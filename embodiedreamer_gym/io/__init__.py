"""Files, progress and parallel work, shared by all parts of the package."""
