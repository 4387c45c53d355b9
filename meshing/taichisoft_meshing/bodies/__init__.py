"""The kinds `step` and `surfaces`: bodies from CAD, checked and meshed."""
