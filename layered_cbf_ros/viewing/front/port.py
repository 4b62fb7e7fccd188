"""The address of the page: free, or refused in words before anything starts."""

from __future__ import annotations

import errno
import socket

from layered_cbf_ros.errors import ParameterError


def listen(host: str, port: int) -> socket.socket:
    """Return a socket that listens on an address; port 0 is any free one.

    Raises:
        ParameterError: If the port is in use, or the address isn't ours.
    """
    try:
        family, kind, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        found = socket.socket(family, kind)
    except OSError as error:
        raise ParameterError(f'--host {host}: {error.strerror}; give an address') from None
    try:
        found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        found.bind(address)
        found.listen()
    except OSError as error:
        found.close()
        raise ParameterError(_refusal(host, port, error)) from None
    return found


def _refusal(host: str, port: int, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return f'--port {port} is in use on {host}; give another one, or --port 0 for any free one'
    if error.errno == errno.EACCES:
        return f'--port {port} is not allowed to us; give one above 1023'
    return f'--host {host}: {error.strerror}; give an address of this machine, as 127.0.0.1'


def own_address(host: str) -> str:
    """Return the address at which others reach us when we are bound to a host."""
    if host not in ('0.0.0.0', '::'):
        return f'[{host}]' if ':' in host else host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way_out:
        try:
            way_out.connect(('192.0.2.1', 9))  # sends nothing: only asks which way it would go
        except OSError:
            return socket.gethostname()
        found: str = way_out.getsockname()[0]
    return found
