"""Pictures of a launch: videos, records of subgoals, a summary."""
