"""A run in progress, as hooks, outputs and displays may see it."""
