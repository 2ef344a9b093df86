"""The live view: an episode that a person steps, whose goal is dragged, and its page."""
