"""The kinds `step` and `surfaces`: bodies that come from elsewhere, checked, mended and meshed."""
