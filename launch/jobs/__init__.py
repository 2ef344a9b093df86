"""Jobs: planning, training in workers here or on a cluster, and recording results."""
