"""Benchmarks: descriptors are data (cases.toml), one runner, and other programs beside it (`taichisoft bench`)."""

from typing import TYPE_CHECKING

from taichisoft.plugin_system.hookspecs import hookimpl

if TYPE_CHECKING:
    import typer


@hookimpl
def taichisoft_commands(application: "typer.Typer") -> None:
    """Add `taichisoft bench`."""
    from taichisoft_benchmarks.command import bench

    application.command()(bench)
