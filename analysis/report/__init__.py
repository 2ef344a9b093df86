"""A self-contained page about a run folder."""
