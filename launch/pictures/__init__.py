"""What a launch leaves to look at: videos, records of subgoals, a summary."""
