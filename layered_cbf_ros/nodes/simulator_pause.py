"""Pause and step: in lockstep the simulator holds the time still, and everybody waits with it."""

from __future__ import annotations

import time

from std_srvs.srv import SetBool, Trigger

from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.node_topics import PAUSE, STEP
from layered_cbf_ros.nodes.graph_node import GraphNode

TURN_S = 0.02  # between two looks for a service call while time stands still
LOOK_NS = 100_000_000  # and while it runs: a person's button shall not feel stuck
NO_LOCKSTEP = 'time can not be held in real time; run the scenario in lockstep'
NOT_PAUSED = f'not paused; call {PAUSE} with data: true first'


class SimulatorPause:
    """Answers /simulator/pause and /simulator/step, and holds the simulator's loop.

    It holds before a state goes out, when everybody has all that the states before it
    ask for: so nobody waits for anything but the next state, and the run goes on with
    the same bits.
    """

    def __init__(self, node: GraphNode) -> None:
        self._node = node
        self._paused = False
        self._stamp_ns = self._until_ns = self._next_look_ns = 0
        self._services = (
            node.create_service(SetBool, PAUSE, self._on_pause),
            node.create_service(Trigger, STEP, self._on_step),
        )

    def hold(self, stamp_ns: int) -> None:
        """Return when the state of this stamp may go out; answer calls until then.

        Raises:
            StopRequestedError: If the node was asked to end.
        """
        self._stamp_ns = stamp_ns
        if (now_ns := time.monotonic_ns()) >= self._next_look_ns:
            self._next_look_ns = now_ns + LOOK_NS
            self._node.serve(at_once=True)
        if not self._holds:
            return
        self._tell()
        while self._holds:
            self._node.serve(at_once=True)
            time.sleep(TURN_S)
        self._tell()

    @property
    def _holds(self) -> bool:
        return self._paused and self._stamp_ns >= self._until_ns

    def _tell(self) -> None:
        """Tell on /diagnostics, now, whether the time stands still."""
        self._node.statistics.details['paused'] = 'true' if self._paused else ''
        self._node.publish_diagnostics('paused' if self._holds else 'running')

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if not self._node.lockstep:
            response.success, response.message = False, NO_LOCKSTEP
            return response
        if request.data and not self._paused:
            self._until_ns = self._stamp_ns
        self._paused = request.data
        seconds = self._stamp_ns / NS_PER_S
        word = 'paused' if request.data else 'going on'
        response.success, response.message = True, f'{word} at {seconds:.3f} s'
        return response

    def _on_step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._node.lockstep or not self._paused:
            words = NOT_PAUSED if self._node.lockstep else NO_LOCKSTEP
            response.success, response.message = False, words
            return response
        self._until_ns = max(self._until_ns, self._stamp_ns) + self._node.timing.plan_ns
        seconds = self._until_ns / NS_PER_S
        response.success, response.message = True, f'stepping to {seconds:.3f} s'
        return response
