"""Lock for one run at a time in a folder, since two would write to the same files."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from taichisoft.atomic_file import named_os_errors
from taichisoft.caller_warnings import warn_caller
from taichisoft.errors import TaichisoftError

FILE_NAME = ".running"


class FolderTaken(TaichisoftError):
    """Another run is in progress in the folder."""


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Lock a folder for this run; a missing folder is made, and removed again if it stays empty.

    The lock is a file lock of the operating system, so it ends with the process, however the process ends. On NFS it
    holds between machines if the server grants locks; on a file system without locks there is a warning.

    Raises:
        FolderTaken: another run has the lock.
        TaichisoftError: the folder cannot be made.
    """
    path = folder / FILE_NAME
    made = [one for one in (folder, *folder.parents) if not one.exists()]
    with named_os_errors(f"--output {folder}"):
        folder.mkdir(parents=True, exist_ok=True)
        file = _locked(path, folder)
    try:
        yield
    finally:
        path.unlink(missing_ok=True)
        os.close(file)
        with suppress(OSError):  # a folder with files stays
            for one in made:
                one.rmdir()


def _locked(path: Path, folder: Path) -> int:
    """Open and lock the file; a file that another run has just removed is no longer a lock and is made again."""
    import fcntl

    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            whose = os.read(file, 200).decode(errors="replace") or "another process"
            os.close(file)
            raise FolderTaken(
                f"--output {folder}: a run is going on there ({whose}); wait for its end, or name another folder"
            ) from None
        except OSError as error:
            warn_caller(f"--output {folder}: cannot be locked ({error.strerror}): see that no other run writes into it")
            return file
        if path.exists() and os.path.samestat(path.stat(), os.fstat(file)):
            os.ftruncate(file, 0)
            os.write(file, f"process {os.getpid()} on {socket.gethostname()}".encode())
            return file
        os.close(file)
