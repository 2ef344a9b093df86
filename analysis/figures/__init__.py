"""Draws figures from tables."""
