"""What a controller sees and what it may ask for."""
