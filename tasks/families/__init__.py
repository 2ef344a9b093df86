"""The suite's worlds, one file a family: a model, its task, and the spec of each."""
