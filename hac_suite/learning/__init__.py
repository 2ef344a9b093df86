"""What a level learns with: networks, replay buffers, optimisers and the learners themselves."""
