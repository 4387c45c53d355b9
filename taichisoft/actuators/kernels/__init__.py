"""Loops over arrays that measure actuators."""
