"""The commands `taichisoft mesh` and `taichisoft mesh info`, their options, and what they show."""
