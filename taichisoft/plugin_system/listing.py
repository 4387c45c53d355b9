"""What `taichisoft plugins` lists."""

from dataclasses import dataclass

from taichisoft.plugin_system import plugins
from taichisoft.plugin_system.commands import command_names, commands_by_plugin
from taichisoft.plugin_system.registry import Origin, hook_names
from taichisoft.plugin_system.run_options import HOOK, options_by_plugin, run_options

LIFE_CYCLE = [name for name in hook_names() if name not in (*plugins.KINDS.values(), "taichisoft_commands", HOOK)]


@dataclass(frozen=True)
class LoadedPlugin:
    """One row of the list.

    Attributes:
        name: under which it can be left out.
        origin: where it came from, with its version.
        provides: controllers, outputs and so on with their names, and the hooks that it is called by.
    """

    name: str
    origin: Origin
    provides: list[str]


def list_plugins() -> list[LoadedPlugin]:
    """Every loaded plug-in, in the order of loading.

    Raises:
        PluginError: one cannot say what it provides, or something that it provides is not valid.
    """
    registry = plugins.plugin_registry()
    provides: dict[str, list[str]] = {name: [] for name in registry.origins}
    for kind in plugins.KINDS:
        plugins.provided(kind)  # no name may be claimed twice
        for name, by_name in plugins.provided_by_plugin(kind):
            provides[name] += [f"{kind} {key}" for key in sorted(by_name)]
    for name, application in commands_by_plugin():
        provides[name] += [f"command {command}" for command in command_names(application)]
    run_options()  # no option may be claimed twice
    for name, options in options_by_plugin():
        provides[name] += [f"option {option} of run" for option in options]
    for hook in LIFE_CYCLE:
        for implementation in plugins.implementations(hook):
            provides[implementation.plugin_name].append(f"{hook}()")
    return [LoadedPlugin(name, origin, provides[name]) for name, origin in registry.origins.items()]
