"""A benchmark of diagnosis that any tool can enter: hidden cases, answers in one JSON schema, a scorer, entries."""
