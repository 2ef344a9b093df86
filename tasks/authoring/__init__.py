"""Help for authors of tasks: a template, and checks."""
