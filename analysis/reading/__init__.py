"""Reads the files of run folders; a damaged file gives an error of one line."""
