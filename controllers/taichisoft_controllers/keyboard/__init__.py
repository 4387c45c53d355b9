"""The controller "keyboard", and the terminal as the source of its keys."""
