"""Statistics over seeds: data in, numbers with intervals out."""
