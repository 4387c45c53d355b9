"""Files of meshes and surfaces, read and written."""
