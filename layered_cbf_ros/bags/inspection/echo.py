"""Prints messages: as YAML like `ros2 topic echo`, or a JSON object a line."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import yaml

from layered_cbf_ros.bags.inspection.plain import plain
from layered_cbf_ros.bags.inspection.problems import cut_off
from layered_cbf_ros.bags.inspection.selection import Selection
from layered_cbf_ros.bags.json_output import finite
from layered_cbf_ros.bags.storage.bag import Bag
from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.bags.storage.topic import Record
from layered_cbf_ros.errors import BagError

DUMPER = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)
SEPARATOR = '---'


def echo(bag: Bag, selection: Selection, as_json: bool, say: Callable[[str], None]) -> list[str]:
    """Print messages.

    Args:
        bag: The bag.
        selection: Which.
        as_json: Print a JSON object a line, not YAML.
        say: Prints a text.

    Returns:
        What is wrong, a line each.

    Raises:
        BagError: If the bag lacks a topic or can't be read.
    """
    decoder, failed = MessageDecoder(), dict[str, tuple[str, int]]()
    ended = True
    for number, record in enumerate(selection.records(bag), 1):
        try:
            message = plain(decoder.decode(record))
        except BagError as error:
            reason, count = failed.get(record.topic.name, (str(error), 0))
            failed[record.topic.name] = reason, count + 1
            continue
        if as_json:
            say(_json_line(record, message))
        else:
            say(_yaml_text(record, message, len(selection.topics) > 1))
        ended = number != selection.count
    cut = [cut_off(bag, bag.span_ns)] if bag.truncated and ended else []
    return [*cut, *_failures(failed)]


def _json_line(record: Record, message: Any) -> str:
    line = {
        'topic': record.topic.name,
        'log_time_ns': record.log_time_ns,
        'publish_time_ns': record.publish_time_ns,
        'message': finite(message),
    }
    return json.dumps(line, allow_nan=False)


def _yaml_text(record: Record, message: Any, with_topic: bool) -> str:
    text = yaml.dump(
        message,
        Dumper=DUMPER,
        default_flow_style=False,
        sort_keys=False,
        allow_unicode=True,
        width=2**31 - 1,
    )
    heading = f'# {record.topic.name}\n' if with_topic else ''
    return f'{heading}{text}{SEPARATOR}'


def _failures(failed: dict[str, tuple[str, int]]) -> Iterator[str]:
    """Yield the first reason why messages of a topic can't be decoded, and how many can't."""
    for reason, count in failed.values():
        yield reason + (f' (and {count - 1} more of this topic)' if count > 1 else '')
