"""Tuning: the search space, one trial, the journal that trials share, and who carries them out."""
