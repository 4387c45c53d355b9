"""From a file to a scene, and from a scene to what it names."""
