"""The 3D scene of one run: everything of a snapshot in its place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from layered_cbf_ros.interfaces import Array
from layered_cbf_ros.scenario import Scenario
from layered_cbf_ros.viewing.scene.plans import BallLayer, PlanLayer, TrailLayer
from layered_cbf_ros.viewing.scene.robots import ForceLayer, RobotLayer
from layered_cbf_ros.viewing.scene.world import ObstacleLayer, build_ground, build_wall
from layered_cbf_ros.viewing.sight.reach import coordinator_parameters
from layered_cbf_ros.viewing.sight.snapshot import Snapshot


@dataclass(frozen=True, slots=True)
class Switch:
    """Something that a person may hide.

    Attributes:
        label: What it is.
        is_on: Whether it is shown at first.
        turn: Shows or hides it.
    """

    label: str
    is_on: bool
    turn: Callable[[bool], None]


class Scene:
    """Draws snapshots of one run.

    Attributes:
        switches: What may be hidden.
    """

    def __init__(self, scene: viser.SceneApi, scenario: Scenario) -> None:
        """Build what doesn't move; what was there before goes."""
        scene.reset()
        names = [robot.name for robot in scenario.robots]
        build_ground(scene)
        middle = scenario_middle(scenario)
        for wall in scenario.walls:
            build_wall(scene, wall, (float(middle[0]), float(middle[1])))
        self._trails = TrailLayer(scene, names)
        self._plans = PlanLayer(scene, names, coordinator_parameters(scenario))
        self._balls = BallLayer(scene)
        self._robots = RobotLayer(scene, names)
        self._forces = ForceLayer(scene)
        self._obstacles = ObstacleLayer(scene)
        self._layers = (
            self._trails, self._plans, self._balls, self._robots, self._forces, self._obstacles,
        )  # fmt: skip
        self.switches = (
            Switch('planned paths', True, self._show_paths),
            Switch('reachable sets', True, self._show_reaches),
            Switch('collision balls', True, self._show_balls),
            Switch('foot forces', True, self._show_forces),
            Switch('names', True, self._robots.show_labels),
        )

    @property
    def wants_forces(self) -> bool:
        """Return whether foot forces are drawn, and so needed."""
        return self._forces.visible

    def draw(self, snapshot: Snapshot) -> None:
        """Draw an instant."""
        for layer in self._layers:
            layer.draw(snapshot)

    def draw_trails(self, snapshot: Snapshot) -> None:
        """Draw only where robots were, of an instant before the one that is shown."""
        self._trails.draw(snapshot)

    def _show_paths(self, wanted: bool) -> None:
        self._trails.lines.visible = self._plans.paths.visible = wanted

    def _show_reaches(self, wanted: bool) -> None:
        self._plans.reaches.visible = wanted

    def _show_balls(self, wanted: bool) -> None:
        self._balls.balls.visible = self._balls.rims.visible = wanted

    def _show_forces(self, wanted: bool) -> None:
        self._forces.visible = wanted


def scenario_middle(scenario: Scenario) -> Array:
    """Return the middle of where the robots begin and want to go [m], (2,)."""
    places = [robot.position for robot in scenario.robots]
    places += [r.desired.goal for r in scenario.robots if r.desired.goal is not None]
    corners = np.array(places, dtype=float).reshape(-1, 2)
    middle: Array = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    return middle
