"""From names to things, through plug-ins: scenes from files, meshes of bodies, controllers."""
