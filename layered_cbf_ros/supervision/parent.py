"""What a child process does first: tie its life to its parent's."""

from __future__ import annotations

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1


def tie_to_parent(parent: int, death_signal: int = signal.SIGKILL) -> None:
    """Leave the terminal's foreground group, and die when the parent does.

    Ctrl-C then reaches the supervisor alone, which ends its children in order. The
    session stays the same: Linux shares the processor out between sessions first.

    Args:
        parent: Process id of the parent.
        death_signal: What the kernel sends when the parent dies.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # no traceback while it still imports
    os.setpgid(0, 0)
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, int(death_signal))
    if os.getppid() != parent:  # it died before we asked to be told
        sys.exit(1)
