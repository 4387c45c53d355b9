"""`python -m taichisoft` is the command `taichisoft`, of the Python that is meant."""

from taichisoft.command_line import main

main()
