"""Many meshes of one geometry, each in a process of its own."""
