"""Which topics are recorded, or played."""

from __future__ import annotations

import re
from dataclasses import dataclass


@dataclass(frozen=True)
class TopicSelection:
    """Topics by name or pattern; whoever names none wants all.

    Attributes:
        topics: Full names of those wanted.
        regex: Found in the names of those wanted, '' for none.
        exclude_topics: Full names of those left out, even if they are wanted.
        exclude_regex: Found in the names of those left out, '' for none.
        hidden: Whether whoever names none wants the hidden ones too.
    """

    topics: frozenset[str] = frozenset()
    regex: str = ''
    exclude_topics: frozenset[str] = frozenset()
    exclude_regex: str = ''
    hidden: bool = False

    def wants(self, topic: str) -> bool:
        """Tell whether a topic is wanted, by name, by pattern, or because all are."""
        if topic in self.exclude_topics or _found(self.exclude_regex, topic):
            return False
        if self.topics or self.regex:
            return topic in self.topics or _found(self.regex, topic)
        return self.hidden or not is_hidden(topic)


def full_name(topic: str) -> str:
    """Return a topic's name as the graph and bags have it: with a slash in front."""
    return f'/{topic.lstrip("/")}'


def is_hidden(topic: str) -> bool:
    """Tell whether a topic is one of those that ROS tools don't show unasked."""
    return any(part.startswith('_') for part in topic.split('/'))


def _found(regex: str, topic: str) -> bool:
    return bool(regex) and re.search(regex, topic) is not None
