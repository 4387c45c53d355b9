"""`taichisoft materials`: laws of rubber fitted to tension tests, listed and drawn."""
