"""From a finger's dimensions to tetrahedra (gmsh)."""
