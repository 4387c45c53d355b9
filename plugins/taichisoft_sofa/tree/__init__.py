"""The tree of a SOFA scene: nodes, components and their data."""
