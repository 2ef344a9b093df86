"""Runs experiments: the command line, job planning, worker processes, run folders and videos."""
