"""Faults of many kinds, and how often something was lost, told of in more than one line, or let in.

`python -m taichisoft_benchmarks.faults` makes the table of docs/reliability.md; a short version is in the tests.
"""
