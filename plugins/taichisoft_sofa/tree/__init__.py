"""What a SOFA scene builds: nodes, components and their data."""
