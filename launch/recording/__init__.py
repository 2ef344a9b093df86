"""Records test episodes of policies in the files that the analysis reads."""
