"""A run folder's files: their names, and the only code that reads and writes them."""
