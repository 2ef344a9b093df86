"""Draws one moment of an episode: bodies, outlined markers and trails, and lanes of attempts."""
