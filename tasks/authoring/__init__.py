"""Help for people who write a task: a file to begin with, and what is wrong with one."""
