"""What test episodes of policies come to, as the files that the analysis reads."""
