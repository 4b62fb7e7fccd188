"""A node that reads the scenario itself: the coordinator, and the simulator."""

from __future__ import annotations

import dataclasses

from layered_cbf_ros.nodes.graph_node import GraphNode
from layered_cbf_ros.scenario import BASES
from layered_cbf_ros.scenario_file import load_scenario
from layered_cbf_ros.timing import InputRules, timing_values


class ScenarioNode(GraphNode):
    """Knows who is there; with bases it has the scenario's rates, unless told others.

    A1s have layers below, which read no scenario: their rates are parameters of all.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._scenario = load_scenario(self.scenario)
        if self._scenario.plant == BASES:
            self._follow_rates()

    def _follow_rates(self) -> None:
        given = {*self._parameter_overrides, 'time'}
        told = {k: value for k, value in timing_values(self._scenario).items() if k not in given}
        self.timing = dataclasses.replace(self.timing, **told)
        self.rules = InputRules(self.timing)
