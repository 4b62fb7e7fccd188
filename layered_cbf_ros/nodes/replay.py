"""replay: sends the messages of a bag again, to everybody or into one live node."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack

import rclpy
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock as ClockMessage

from layered_cbf_ros.bags.command_line import EXIT_BAD_INPUT, EXIT_INTERRUPTED, run_verb
from layered_cbf_ros.bags.playback.command_line import Options, parse
from layered_cbf_ros.bags.playback.following import Following
from layered_cbf_ros.bags.playback.player import Chore, Clock, Player
from layered_cbf_ros.bags.playback.progress import Progress
from layered_cbf_ros.bags.playback.read_ahead import ReadAhead
from layered_cbf_ros.bags.playback.replay_plan import (
    CLOCK,
    ReplayPlan,
    latched_before,
    plan_replay,
    records_of_round,
)
from layered_cbf_ros.bags.playback.schedule import Schedule
from layered_cbf_ros.bags.playback.terminal import Keyboard, is_controllable
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.interfaces import NS_PER_S
from layered_cbf_ros.messages import standard
from layered_cbf_ros.nodes.diagnostics import PERIOD_NS, DiagnosticsPublisher
from layered_cbf_ros.nodes.replay_partners import Partners, wait_for_readers
from layered_cbf_ros.nodes.replay_publishers import ReplayPublishers
from layered_cbf_ros.nodes.transport import find_each_other_fast, reliable

ROS_ARGUMENTS = '--ros-args'
KEYS_NS = 20_000_000
SWITCH_S = 0.0005  # how long the thread that reads the bag may keep a message waiting
ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


class Replay:
    """One replay, from the first look at the graph to the last word."""

    def __init__(self, node: Node, bag: Bag, plan: ReplayPlan, options: Options) -> None:
        self._bag, self._plan, self._options = bag, plan, options
        self._publishers = ReplayPublishers(node, bag.topics, plan.names)
        self._following = self._partners = None
        if plan.fed is not None:
            self._partners = Partners(node, plan.fed)
            self._following = Following(plan.fed, self._partners.take)
        schedule = Schedule(plan.start_ns, 0, options.rate, options.start_paused)
        may_send = self._following.may_send if self._following and options.following else None
        clock = Clock(time.monotonic_ns, time.sleep)
        self._player = Player(schedule, self._publishers.publish, clock, may_send)
        self._clock_publisher = (
            node.create_publisher(ClockMessage, CLOCK, reliable(10)) if options.clock_hz else None
        )
        self._diagnostics = DiagnosticsPublisher(node)
        self._used_s = self._lasted_s = 0.0
        self._unacknowledged: list[str] = []
        for number in ENDINGS:
            signal.signal(number, self._stop)

    def run(self) -> int:
        """Play all that was asked for; return the exit code."""
        with ExitStack() as stack:
            self._find_listeners()
            self._add_chores(stack)
            for record in latched_before(self._bag, self._plan, self._publishers.latched):
                self._publishers.publish(record)
            before = time.process_time(), time.monotonic()
            self._play()
            self._used_s = time.process_time() - before[0]
            self._lasted_s = time.monotonic() - before[1]
            limit_s = self._options.acknowledged_ms / 1000 or float('inf')
            self._unacknowledged = self._publishers.not_acknowledged(limit_s, self._is_stopped)
        self._note_health()
        self._diagnostics.close()
        self._report()
        if self._player.stopped:
            return EXIT_INTERRUPTED
        return EXIT_BAD_INPUT if self._bag.truncated or self._publishers.left_out else 0

    def _find_listeners(self) -> None:
        """Wait for who listens, and tell what is not as it should be."""
        wait_for_readers(self._publishers, self._is_stopped)
        self._publishers.check_types(self._bag.topics)
        for topic, reason in self._publishers.left_out.items():
            _warn(f'{topic} is left out: {reason}')
        for note in (*self._plan.notes, *self._publishers.warnings()):
            _warn(note)
        partners, following, player = self._partners, self._following, self._player
        fed = self._plan.fed
        if fed is None or partners is None or following is None:
            return
        self._diagnostics.statistics.wait_for(fed.name, time.monotonic_ns())
        partners.wait_until_listening(self._publishers, _warn, self._keep_up)
        self._diagnostics.statistics.waiting_for = ''
        if not player.stopped and partners.in_real_time():
            following.expect_real_time()

    def _add_chores(self, stack: ExitStack) -> None:
        """Have keys obeyed, progress shown and the clock sent, until the stack is left."""
        options, plan, player = self._options, self._plan, self._player
        player.chores.append(Chore(PERIOD_NS, self._tell_health))
        keyboard = None
        if options.keyboard and is_controllable():
            keyboard = stack.enter_context(Keyboard())
            signal.signal(signal.SIGCONT, lambda *_: keyboard.take_over())
            stack.callback(signal.signal, signal.SIGCONT, signal.SIG_DFL)
            player.chores.append(Chore(KEYS_NS, lambda _: self._obey(keyboard)))
        elif options.start_paused:
            raise BagError('--start-paused needs a terminal whose keys are obeyed')
        end_ns = plan.end_ns - plan.begin_ns
        progress = Progress(sys.stdout, sys.stdout.isatty(), keyboard is not None, end_ns)
        stack.callback(progress.end)
        player.chores.append(Chore(progress.period_ns, lambda now: self._show(progress, now)))
        if self._clock_publisher is not None:
            period_ns = max(1, round(NS_PER_S / options.clock_hz))
            player.chores.append(Chore(period_ns, self._send_clock))

    def _play(self) -> None:
        """Play one round, or round after round."""
        plan, player = self._plan, self._player
        while not player.stopped:
            records = ReadAhead(records_of_round(self._bag, plan, self._publishers.topics))
            records.wait_until_filled()
            player.schedule.restart(plan.start_ns, time.monotonic_ns())
            if self._options.delay:
                player.rest(round(self._options.delay * NS_PER_S))
            try:
                player.play(records)
            finally:
                records.close()
            if not self._options.loop:
                return

    def _report(self) -> None:
        """Tell what was sent, how well, and what is missing."""
        player, bag = self._player, self._bag
        ended = 'stopped after' if player.stopped else 'sent'
        print(f'{ended} {player.sent} messages in {self._lasted_s:.1f} s')
        if player.sent:
            print(f'processor time: {1e3 * self._used_s / player.sent * 1e3:.0f} us a message')
        print('\n'.join(player.errors.lines()))
        if self._following is not None and self._plan.fed is not None:
            self._following.listen()
            answers, held_s = self._following.answers, player.held_ns / NS_PER_S
            topic = self._plan.fed.outputs[0].topic
            name = self._plan.fed.name
            print(f'{name} answered {answers} times on {topic}; it held the replay {held_s:.1f} s')
        sys.stdout.flush()
        if self._unacknowledged and not player.stopped:
            _warn(f'some readers do not have all of {", ".join(self._unacknowledged)} yet')
        if bag.truncated:
            _warn(f'{bag.path} is cut off or spoilt; it was played as far as it is whole')

    def _obey(self, keyboard: Keyboard) -> None:
        for key in keyboard.pressed():
            self._player.press(key)

    def _show(self, progress: Progress, now_ns: int) -> None:
        schedule = self._player.schedule
        bag_ns = schedule.bag_time_ns(now_ns) - self._plan.begin_ns
        progress.show(bag_ns, schedule.rate, 'paused' if schedule.paused else 'playing')

    def _send_clock(self, now_ns: int) -> None:
        if self._clock_publisher is not None:
            bag_ns = self._player.schedule.bag_time_ns(now_ns)
            self._clock_publisher.publish(standard.clock(bag_ns))

    def _keep_up(self) -> bool:
        """Tell how it fares while it waits; return whether it is to end."""
        self._diagnostics.serve(time.monotonic_ns())
        return self._player.stopped

    def _tell_health(self, now_ns: int) -> None:
        self._note_health()
        self._diagnostics.publish(now_ns)

    def _note_health(self) -> None:
        """Note how well messages are sent: jitter is how late they are."""
        player, statistics = self._player, self._diagnostics.statistics
        errors = player.errors
        statistics.state = 'paused' if player.schedule.paused else 'running'
        statistics.ticks = player.sent
        statistics.deadline_misses = errors.late
        statistics.details |= {
            'jitter_p99_us': f'{errors.percentile_ns(0.99) / 1e3:.0f}',
            'jitter_max_us': f'{errors.max_ns / 1e3:.0f}',
        }

    def _is_stopped(self) -> bool:
        return self._player.stopped

    def _stop(self, number: int, frame: object) -> None:
        self._player.stopped = True


def replay(arguments: Sequence[str]) -> int:
    """Play a bag; return the exit code.

    Raises:
        BagError, GraphError: If it can't be played as asked.
    """
    # rclpy would take an OLD:=NEW of --remap for a rule of its own, wherever it stands
    at = arguments.index(ROS_ARGUMENTS) if ROS_ARGUMENTS in arguments else len(arguments)
    options = parse(arguments[:at])
    bag = open_bag(options.bag)
    plan = plan_replay(bag, options)
    sys.setswitchinterval(SWITCH_S)
    find_each_other_fast()
    rclpy.init(args=list(arguments[at:]), signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = Node('replay', enable_rosout=False, start_parameter_services=False)
        return Replay(node, bag, plan, options).run()
    finally:
        rclpy.try_shutdown()


def _warn(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def main() -> None:
    """Run the program."""
    run_verb(replay)
