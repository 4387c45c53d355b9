"""The scene's own controllers, live: what they read is the present state, what they write steers the run."""
