"""Whether this machine has what taichisoft needs."""
