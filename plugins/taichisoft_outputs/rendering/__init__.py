"""Pictures and videos of recordings, drawn in child processes."""
