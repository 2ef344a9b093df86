"""Parses the command line: flags in, a checked request or one clear error out."""
