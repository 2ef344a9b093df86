"""The robots that tasks are built on: one entity and its kinematics per file."""
