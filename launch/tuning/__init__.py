"""Tuning: the search space, one trial, the shared journal of trials, and the workers."""
