"""The `taichisoft` command."""


def main() -> None:
    """Run the command line."""
