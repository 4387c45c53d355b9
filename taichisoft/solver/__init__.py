"""The constraint problem of contacts and actuators, and its solution."""
