"""One run at a time in a folder: two would write into the same files."""

import os
import socket
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from taichisoft.atomic_file import named_os_errors
from taichisoft.errors import TaichisoftError

FILE_NAME = ".running"


class FolderTaken(TaichisoftError):
    """Another run is going on in the folder."""


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Keep a folder, which is made if it is not there, for this run; one that stays empty goes again.

    The lock is the operating system's on a file in the folder, so it ends with the process, however that ends. On NFS
    it holds between machines, if the server grants locks; where a file system has none, a warning says so.

    Raises:
        FolderTaken: another run has it.
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
        with suppress(OSError):  # what has files stays
            for one in made:
                one.rmdir()


def _locked(path: Path, folder: Path) -> int:
    """The open, locked file of the path; one that its run has just removed is no lock any more, and made anew."""
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
            warnings.warn(
                f"--output {folder}: cannot be locked ({error.strerror}): see that no other run writes into it",
                stacklevel=4,
            )
            return file
        if path.exists() and os.path.samestat(path.stat(), os.fstat(file)):
            os.ftruncate(file, 0)
            os.write(file, f"process {os.getpid()} on {socket.gethostname()}".encode())
            return file
        os.close(file)
