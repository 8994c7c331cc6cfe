"""Files, progress and parallel work: what every part of the package writes and shows in the same way."""
