"""Where surfaces come near each other."""
