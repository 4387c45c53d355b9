"""Moulds: of a finger in two castings, of any other body its negative; and whether they can be printed and opened."""
