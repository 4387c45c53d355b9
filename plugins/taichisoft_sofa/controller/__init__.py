"""Live control by a scene's own controllers: they read the present state, and their writes steer the run."""
