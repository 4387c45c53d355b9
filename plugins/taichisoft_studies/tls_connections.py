"""TLS connections that do not end for an error of another one.

From OpenSSL 3.2 on, a connection that breaks leaves an error in a queue of its thread, and Python does not empty that
queue before it reads the next connection (https://github.com/python/cpython/issues/148594, open for Python 3.12 to
3.15). The next connection, which is healthy, then fails with the error of the first: a worker is lost when a client
goes. `dask scheduler --preload taichisoft_studies.tls_connections` has these connections too, as has `dask worker`.
"""

import ssl
from collections.abc import Callable
from typing import Any

from distributed.security import Security  # noqa: TID253 - imported by functions, and by Dask, alone

_CONTEXT = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
_CONTEXT.check_hostname = False


class TlsConnection(ssl.SSLSocket):
    """A connection that does again, once and with an empty queue, what failed with an error of the system.

    Reading, writing and shaking hands may be tried again: what was left by another connection does not come back, and
    what is wrong with this one does.
    """

    def read(self, *arguments: Any) -> Any:
        """See `ssl.SSLSocket.read`."""
        return _with_own_errors(super().read, *arguments)

    def send(self, *arguments: Any) -> Any:
        """See `ssl.SSLSocket.send`."""
        return _with_own_errors(super().send, *arguments)

    def do_handshake(self, block: bool = False) -> None:
        """See `ssl.SSLSocket.do_handshake`."""
        _with_own_errors(super().do_handshake, block)


def _with_own_errors(action: Callable[..., Any], *arguments: Any) -> Any:
    try:
        return action(*arguments)
    except ssl.SSLError:  # TLS has more to read or write, or is broken: of this connection in any case
        raise
    except OSError:
        _CONTEXT.wrap_bio(ssl.MemoryBIO(), ssl.MemoryBIO())  # a new connection begins with an empty queue
        return action(*arguments)


class SecurityOfStudies(Security):  # type: ignore[misc]  # Dask has no types
    """Dask's credentials, with these connections."""

    def get_listen_args(self, role: str) -> dict[str, Any]:
        """See `distributed.security.Security.get_listen_args`."""
        return _made_so(super().get_listen_args(role))

    def get_connection_args(self, role: str) -> dict[str, Any]:
        """See `distributed.security.Security.get_connection_args`."""
        return _made_so(super().get_connection_args(role))


def _made_so(arguments: dict[str, Any]) -> dict[str, Any]:
    if arguments["ssl_context"] is not None:
        arguments["ssl_context"].sslsocket_class = TlsConnection
    return arguments


def dask_setup(_server: Any) -> None:
    """Have all connections of this process so; Dask calls it (`--preload`)."""
    ssl.SSLContext.sslsocket_class = TlsConnection
