"""What a person typed: flags in, a checked request or one clear error out."""
