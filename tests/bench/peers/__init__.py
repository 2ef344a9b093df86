"""Strangers on our tasks: stable-baselines3's agents with hindsight, trained and tested as ours."""
