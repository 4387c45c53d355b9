"""`python -m taichisoft` runs the command `taichisoft`."""

from taichisoft.command_line import main

main()
