"""An episode at a moment: bodies, outlined markers and trails, and lanes of attempts."""
