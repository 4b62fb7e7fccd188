"""A viser server for this machine alone: people reach it through the front."""

from __future__ import annotations

import contextlib
import io
import logging
import socket

import viser

LOOPBACK = '127.0.0.1'


def start_viser() -> viser.ViserServer:
    """Return a server on a free port of the loopback, which prints nothing."""
    for name in ('websockets', 'websockets.server'):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # a visitor who goes is no error
    with contextlib.redirect_stdout(io.StringIO()):  # its banner names a port that isn't ours
        return viser.ViserServer(LOOPBACK, _free_port(), verbose=False)


def stop_viser(server: viser.ViserServer) -> None:
    """End a server, as quietly."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def _free_port() -> int:
    with socket.socket() as trial:
        trial.bind((LOOPBACK, 0))
        port: int = trial.getsockname()[1]
    return port
