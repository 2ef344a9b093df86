"""Training populations of seeds, and testing them."""
