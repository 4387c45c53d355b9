"""Faults of many kinds, and how often data was lost, an error took more than one line, or a stranger was let in.

`python -m taichisoft_benchmarks.faults` prints a table of tries and failures; the tests make a few tries of each row.
"""
