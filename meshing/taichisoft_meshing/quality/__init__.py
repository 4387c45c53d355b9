"""How good a mesh is: measured, held against limits, and shown."""
