"""The recorder's command line: flags as users of `ros2 bag record` know them.

Each flag becomes a ROS parameter of the node, so that there is one way to tell it
anything: by flag, by `--ros-args -p NAME:=VALUE`, or by a parameter file.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence

from layered_cbf_ros.bags.recording.parameters import RecorderParameters
from layered_cbf_ros.bags.storage.presets import PRESETS
from layered_cbf_ros.parameters import described

ROS_ARGUMENTS, END_OF_THEM = '--ros-args', '--'
DESCRIPTION = 'Record topics into a bag, and count what is lost on the way. Ctrl-C ends it.'
EPILOG = """\
Without topics and regex, all topics are recorded, and those that appear later; hidden
ones must be named. --exclude-topics and --exclude-regex go before all else.

The exit code is 0 if all that was sent is in the bag; 1 if messages were lost, or a topic
could not be recorded; 2 if the command was wrong, or the bag could not be written.

Each option is a ROS parameter too, for --ros-args -p NAME:=VALUE or a parameter file:
"""


def ros_arguments(arguments: Sequence[str]) -> list[str]:
    """Return the arguments for ROS that say the same as the flags.

    Exits with a message if the flags are wrong, or with the help if that is asked for.
    """
    flags, for_ros = _separated(arguments)
    options = vars(_parser().parse_args(flags))
    del options['all']
    options['topics'] = [*options.pop('positional'), *options['topics']]
    given: list[str] = []
    for name, value in options.items():
        if value not in (None, False, []):
            text = json.dumps(' '.join(value) if isinstance(value, list) else value)
            given += ['-p', f'{name}:={text}']
    return [*for_ros, ROS_ARGUMENTS, *given] if given else for_ros


def _separated(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return what is for us, and what is for ROS."""
    flags: list[str] = []
    for_ros: list[str] = []
    target = flags
    for argument in arguments:
        if argument == ROS_ARGUMENTS:
            target = for_ros
        target.append(argument)
        if argument == END_OF_THEM and target is for_ros:
            target = flags
    return flags, for_ros


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='recorder',
        usage='recorder [OPTION ...] [TOPIC ...] [--ros-args ...]',
        description=DESCRIPTION,
        epilog=EPILOG + '\n'.join(_parameter_lines()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = parser.add_argument
    add('positional', nargs='*', metavar='TOPIC', help='topics to record')
    add('--topics', nargs='+', default=[], metavar='TOPIC', help='topics to record')
    add('-e', '--regex', metavar='REGEX', help='record topics in which it is found, as well')
    add('--exclude-topics', nargs='+', default=[], metavar='TOPIC', help='topics to leave out')
    add('-x', '--exclude-regex', metavar='REGEX', help='leave out topics in which it is found')
    add('-a', '--all', action='store_true', help='record all topics, which it does anyway')
    add('-o', '--output', metavar='DIR', help='folder of the bag, default rosbag2_ with the date')
    add('-b', '--max-bag-size', type=int, metavar='BYTES', help='begin a new file at this size')
    add('-d', '--max-bag-duration', type=float, metavar='S', help='begin a new file after so long')
    add(
        '--storage-preset-profile',
        dest='storage_preset',
        choices=tuple(PRESETS),
        help='default lz4',
    )
    add('--chunk-size', type=int, metavar='BYTES', help='a kill loses at most one chunk')
    add('--force', action='store_true', help='replace the bag that is in the folder')
    return parser


def _parameter_lines() -> list[str]:
    """Return one line for each parameter."""
    return [
        f'  {field.name}: {described(field)} = {field.default!r}'
        for field in dataclasses.fields(RecorderParameters)
    ]
