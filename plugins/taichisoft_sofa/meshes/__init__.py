"""Mesh files, read and transformed as by SOFA's loaders."""
