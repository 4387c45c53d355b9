"""Studies of the results themselves: how they change with the mesh, and where finer meshes lead."""
