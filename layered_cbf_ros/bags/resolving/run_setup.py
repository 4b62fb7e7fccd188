"""How the nodes of a recorded run were set up, as its bag tells it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from layered_cbf_ros.bags.recorded_scenario import recorded_scenario
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.node_topics import ONE_OF_A_KIND, PER_ROBOT, SCENARIO
from layered_cbf_ros.parameters import from_mapping, parameters_of
from layered_cbf_ros.scenario import BASES, Scenario
from layered_cbf_ros.scenario_checks import SETTLED
from layered_cbf_ros.timing import TimingParameters, timing_values

P = TypeVar('P')
Values = Mapping[str, Any]


@dataclass(frozen=True)
class RunSetup:
    """A run's scenario, and what is asked otherwise of its nodes.

    Attributes:
        scenario: What was run, with the value of every parameter.
        changes: Parameters to be taken instead of the recorded ones, by node.
    """

    scenario: Scenario
    changes: Mapping[str, Values] = dataclasses.field(default_factory=dict)

    @property
    def robots(self) -> list[str]:
        """Return the names of the robots."""
        return [robot.name for robot in self.scenario.robots]

    @property
    def nodes(self) -> list[str]:
        """Return the nodes that can be re-solved, `a1_0/ground_force_mpc` for one of a robot."""
        sole = [
            name for name in ONE_OF_A_KIND if name != 'obstacle_tracker' or self.scenario.obstacles
        ]
        legged = () if self.scenario.plant == BASES else self.robots
        return sole + [f'{robot}/{kind}' for robot in legged for kind in PER_ROBOT]

    @property
    def changed_scenario(self) -> Scenario:
        """Return the scenario with those changes in it that hold for all nodes of a kind."""
        parameters = {kind: dict(values) for kind, values in self.scenario.parameters.items()}
        for kind in parameters:
            alike = [n for n in self.nodes if n.rpartition('/')[2] == kind]
            first = dict(self.changes.get(alike[0], {})) if alike else {}
            for name, value in first.items():
                shared = all(self.changes.get(n, {}).get(name) == value for n in alike)
                if shared and name not in SETTLED:
                    parameters[kind][name] = value
        return dataclasses.replace(self.scenario, parameters=parameters)

    def timing(self, node: str) -> TimingParameters:
        """Return the timing of a node.

        Raises:
            BagError: If the scenario doesn't tell.
        """
        settled = timing_values(self.scenario)
        return from_mapping(TimingParameters, {**self._recorded(node, TimingParameters), **settled})

    def parameters(self, node: str, cls: type[P]) -> P:
        """Return a node's parameters, with the changes in them.

        Raises:
            BagError: If the scenario doesn't tell one of them.
            ParameterError: If one is out of its range.
        """
        values = dict(self._recorded(node, cls))
        robot, _, kind = node.rpartition('/')
        if kind == 'ground_force_mpc':
            gaits = {r.name: r.gait for r in self.scenario.robots}
            values['gait'] = gaits[robot]
        own = parameters_of(cls)
        changes = {name: v for name, v in self.changes.get(node, {}).items() if name in own}
        return from_mapping(cls, {**values, **changes})

    def _recorded(self, node: str, cls: type[P]) -> dict[str, Any]:
        """Return the recorded values of a parameter class, but those that rates settle."""
        kind = node.rpartition('/')[2]
        known = self.scenario.parameters.get(kind, {})
        changed = self.changes.get(node, {})
        values = {}
        for name in parameters_of(cls):
            if name in known:
                values[name] = known[name]
            elif name not in SETTLED and name not in changed:
                raise BagError(
                    f"{SCENARIO} has no {kind}.{name}: the run's gains are not known; "
                    'record runs that the supervisor has started, or give it with --params'
                )
        return values


def read_setup(bag: Bag) -> RunSetup:
    """Read the scenario of a bag.

    Raises:
        BagError: If there is none, or it isn't one.
    """
    return RunSetup(recorded_scenario(bag))
