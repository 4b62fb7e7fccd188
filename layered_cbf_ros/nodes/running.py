"""From a process to a node and back: start, help, errors, exit code."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable

import rclpy
from rclpy.signals import SignalHandlerOptions

from layered_cbf_ros.errors import (
    EXIT_MISSING,
    LayeredCbfError,
    MissingInputError,
    StopRequestedError,
)
from layered_cbf_ros.node_parameters import NODE_PARAMETERS
from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.parameters import described, parameters_of

EXIT_ERROR = 2


def run_node(make: Callable[[], GraphNode]) -> None:
    """Start a node, run it to its end, and turn every error into one line."""
    if {'-h', '--help'} & set(sys.argv[1:]):
        print(help_text(make))
        return
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = None
    code = 0
    try:
        node = make()
        node.refuse_unknown_parameters()
        node.run()
    except StopRequestedError:
        code = 0 if node is None else node.exit_code
    except MissingInputError as error:
        code = EXIT_MISSING
        print(error, file=sys.stderr, flush=True)
    except LayeredCbfError as error:
        code = EXIT_ERROR
        print(f'ERROR {error}', file=sys.stderr, flush=True)
    if node is not None:
        node.close()
    else:
        gc.collect()  # a node that was only half made has to go before its context does
    rclpy.shutdown()
    sys.exit(code)


def help_text(node_class: Callable[[], object]) -> str:
    """Return a node's purpose, usage and parameters, as text for a terminal."""
    purpose = (sys.modules[node_class.__module__].__doc__ or '').strip()
    name = node_class.__module__.rpartition('.')[2]
    lines = [purpose, '', f'usage: {name} --ros-args [-r __ns:=/ROBOT] [-p NAME:=VALUE] ...', '']
    for cls in NODE_PARAMETERS.get(name, ()):
        for name_, field in parameters_of(cls).items():
            lines.append(f'  {name_}: {described(field)} = {field.default}')
    return '\n'.join(lines)
