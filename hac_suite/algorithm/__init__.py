"""Algorithms 1 and 2 of the paper as array code over many environments; nothing here learns."""
