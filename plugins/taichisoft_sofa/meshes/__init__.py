"""Mesh files as SOFA's loaders read and place them."""
