"""A diagnosis benchmark open to any tool: hidden cases, answers in one JSON schema, a scorer, entries."""
