"""Tries of faults of many kinds, of which the tests make a few: damaged files, odd inputs, killed processes."""
