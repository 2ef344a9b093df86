"""The live view: an episode that the user steps, whose goal can be dragged, and its page."""
