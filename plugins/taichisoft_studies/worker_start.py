"""What a worker on this machine does when it starts; Dask loads it (`preload`)."""

import signal
import threading
from typing import Any


def dask_setup(worker: Any) -> None:
    """Ignore Ctrl and c, which a terminal sends to all processes: the command ends its workers itself."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
