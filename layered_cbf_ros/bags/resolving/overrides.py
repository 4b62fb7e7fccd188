"""Other gains for re-solved nodes, from a ROS parameter file."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from layered_cbf_ros.bags.resolving.run_setup import RunSetup, Values
from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.node_parameters import NODE_PARAMETERS, parameter_names
from layered_cbf_ros.parameters import read_parameter_file, values_of
from layered_cbf_ros.timing import TimingParameters
from layered_cbf_ros.yaml_entry import suggestion

OF_THE_RUN = frozenset(('scenario', 'recorded', 'state_topic', 'output', 'wait_for'))
"""What a run's own parameter file has besides gains."""

OTHER_NODES = frozenset(('simulator', 'recorder'))


def with_changes(setup: RunSetup, file: Path, nodes: Sequence[str]) -> RunSetup:
    """Return a setup in which the values of a file go before the recorded ones.

    Args:
        setup: As recorded.
        file: ROS parameter file, partly filled; a node is named like its kind, for all
            robots, or in full.
        nodes: Those that are to be re-solved.

    Raises:
        ParameterError: If the file can't be read, names something unknown, or asks for
            what can't be changed afterwards.
    """
    changes: dict[str, dict[str, Any]] = {}
    for given, values in read_parameter_file(file).items():
        name = given.strip('/')
        kind = name.rpartition('/')[2]
        chosen = [node for node in setup.nodes if name in (node, node.rpartition('/')[2])]
        if not chosen and kind not in OTHER_NODES and name not in NODE_PARAMETERS:
            known = (*NODE_PARAMETERS, *setup.nodes)
            hint = suggestion(name, known)
            raise ParameterError(f"{file}: no node '{given}'; {hint}there are {', '.join(known)}")
        for node in chosen:
            changes.setdefault(node, {}).update(_checked(setup, node, file, values))
    asked = {node: changes[node] for node in nodes if changes.get(node)}
    if not asked:
        raise ParameterError(f'{file} says nothing of {", ".join(nodes)}; name one of its nodes')
    return dataclasses.replace(setup, changes=asked)


def _checked(setup: RunSetup, node: str, file: Path, values: Values) -> Values:
    """Return the gains among the values; all names and times must be right."""
    kind = node.rpartition('/')[2]
    known = parameter_names(kind)
    timing = values_of(setup.timing(node))
    gains = {}
    for name, value in values.items():
        if name in OF_THE_RUN:
            continue
        if name not in known:
            raise ParameterError(
                f"{file}: {kind} has no parameter '{name}'; {suggestion(name, known)}"
                f'known are {", ".join(known)}'
            )
        if name not in timing:
            gains[name] = value
        elif value != timing[name]:
            raise ParameterError(
                f'{file}: {kind}.{name} is {value!r}, but the run was recorded with '
                f'{timing[name]!r}; leave out what belongs to {TimingParameters.__name__}'
            )
    for cls in NODE_PARAMETERS[kind]:
        if cls is not TimingParameters:
            try:
                dataclasses.replace(setup, changes={node: gains}).parameters(node, cls)
            except ParameterError as error:
                raise ParameterError(f'{file}: {error}') from None
    return gains
