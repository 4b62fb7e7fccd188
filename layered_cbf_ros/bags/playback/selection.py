"""Which topics of a bag are played, and under which names."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from layered_cbf_ros.bags.storage.topic import Topic
from layered_cbf_ros.bags.topic_selection import TopicSelection, full_name
from layered_cbf_ros.errors import BagError

RULE = ':='


@dataclass(frozen=True)
class Selection:
    """What the user asks for.

    Attributes:
        topics: Only these, all if there are none and no `regex`.
        regex: Also those in whose names this is found; '' for none.
        exclude: Not these.
        exclude_regex: Nor those in whose names this is found; '' for none.
        remap: New names by recorded names.
    """

    topics: tuple[str, ...] = ()
    regex: str = ''
    exclude: tuple[str, ...] = ()
    exclude_regex: str = ''
    remap: Mapping[str, str] = field(default_factory=dict)


def select(topics: Mapping[str, Topic], wanted: Selection) -> dict[str, str]:
    """Return the names to send under, by the recorded names of the chosen topics.

    Args:
        topics: Of the bag.
        wanted: What was asked for.

    Raises:
        BagError: If a named topic isn't in the bag, nothing is left, or two topics of
            different types would get one name.
    """
    _check_known('--topics', wanted.topics, topics)
    _check_known('--exclude-topics', wanted.exclude, topics)
    _check_known('--remap', wanted.remap, topics)
    selection = TopicSelection(
        frozenset(wanted.topics),
        wanted.regex,
        frozenset(wanted.exclude),
        wanted.exclude_regex,
        hidden=True,
    )
    chosen = [name for name in topics if selection.wants(name)]
    if not chosen:
        raise BagError(f'no topic is left to play of {_listed(topics)}; choose others')
    names = {name: wanted.remap.get(name, name) for name in chosen}
    types: dict[str, str] = {}
    for name, sent_as in names.items():
        kind = topics[name].type_name
        if types.setdefault(sent_as, kind) != kind:
            raise BagError(
                f"--remap sends {kind} and {types[sent_as]} to '{sent_as}'; give them two names"
            )
    return names


def parse_remap(rules: Sequence[str]) -> dict[str, str]:
    """Return new names by old names.

    Args:
        rules: Each OLD:=NEW.

    Raises:
        BagError: If a rule is of another form, or a topic gets two names.
    """
    found: dict[str, str] = {}
    for rule in rules:
        old, sign, new = rule.partition(RULE)
        if not old.strip('/') or not sign or not re.fullmatch(r'/?\w+(/\w+)*', new):
            raise BagError(f"--remap '{rule}' is no rule; write OLD:=NEW, as /state:=/old/state")
        if full_name(old) in found:
            raise BagError(f"--remap '{rule}' is the second rule for {full_name(old)}; give one")
        found[full_name(old)] = full_name(new)
    return found


def _check_known(flag: str, names: Collection[str], topics: Mapping[str, Topic]) -> None:
    for name in names:
        if name not in topics:
            raise BagError(f"{flag}: '{name}' is not in the bag; it holds {_listed(topics)}")


def _listed(topics: Mapping[str, Topic]) -> str:
    return ', '.join(sorted(topics)) or 'no topics'
