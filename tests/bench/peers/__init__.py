"""Peers: stable-baselines3's agents with hindsight, trained and tested on our tasks as ours are."""
