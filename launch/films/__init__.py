"""Films and stills of test episodes, alone or side by side, and the files that hold them."""
