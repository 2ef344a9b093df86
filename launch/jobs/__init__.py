"""Jobs: planning them, training them in workers here or on a cluster, keeping what they report."""
