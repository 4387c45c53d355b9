"""The parts of a time step."""
