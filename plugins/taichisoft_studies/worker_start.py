"""What a worker on this machine does when it starts; Dask loads it (`preload`)."""

import logging
import signal
import threading
from typing import Any


def dask_setup(worker: Any) -> None:
    """Ignore Ctrl and c, which a terminal sends to all processes: the command ends its workers itself.

    Nor does it say anything of connections that end with the command.
    """
    for name in ("distributed", "tornado", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    logging.getLogger("distributed.worker").setLevel(logging.CRITICAL)  # which has a level of its own
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
