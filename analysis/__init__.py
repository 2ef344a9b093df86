"""Reads run folders, computes statistics over seeds, draws figures and writes reports."""
