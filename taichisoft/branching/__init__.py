"""Many futures of one state."""
