"""The suite's tasks, one file per family: a model, its tasks, and their specs."""
