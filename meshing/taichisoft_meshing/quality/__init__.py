"""The quality of a mesh: measured, compared with limits, and shown."""
