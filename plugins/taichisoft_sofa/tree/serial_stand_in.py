"""A stand-in for pyserial, for scenes that talk to a robot: no port is there, and nothing is sent or read."""

import importlib.util
import logging
from types import ModuleType
from typing import Any

LOG = logging.getLogger("taichisoft_sofa.scene")
IS_INSTALLED = importlib.util.find_spec("serial") is not None  # looked up once, since a search leaves traces in `sys`


class Serial:
    """A port to which nothing is connected."""

    def __init__(self, port: str | None = None, *_arguments: Any, **_named: Any) -> None:
        self.port, self.is_open, self.in_waiting = port, True, 0
        LOG.warning("serial.Serial(%r): pyserial is not installed; nothing is sent or read", port)

    def write(self, content: bytes) -> int:
        """Discard the content; returns its length."""
        return len(content)

    def readline(self, *_size: int) -> bytes:
        """Nothing."""
        return b""

    read = readline

    def close(self) -> None:
        """Close the port."""
        self.is_open = False

    flush = reset_input_buffer = reset_output_buffer = flushInput = flushOutput = open = lambda self: None


def serial_modules() -> dict[str, ModuleType]:
    """Modules in place of pyserial's, by name; none if it is installed."""
    if IS_INSTALLED:
        return {}
    names = ("serial", "serial.tools", "serial.tools.list_ports")
    serial, tools, ports = modules = [
        ModuleType(name, "In place of pyserial, which is not installed.") for name in names
    ]
    vars(serial).update(tools=tools, Serial=Serial, SerialException=OSError, __path__=[])
    vars(tools).update(list_ports=ports, __path__=[])
    vars(ports).update(comports=list)
    return dict(zip(names, modules, strict=True))
