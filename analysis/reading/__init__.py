"""Reads the files of run folders; what is wrong with one is said in one line."""
