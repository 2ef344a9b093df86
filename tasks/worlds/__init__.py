"""Environments that others made, and spaces for tasks that come without them."""
