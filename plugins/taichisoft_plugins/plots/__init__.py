"""Curves of a recording."""
