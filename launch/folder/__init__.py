"""A run folder's files: what they are called, and the only code that reads and writes them."""
