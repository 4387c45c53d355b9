"""Making a run: the loop around the step, its pace and keys, and what the command line shows of it."""
