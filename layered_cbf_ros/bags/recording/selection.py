"""Which topics are recorded."""

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
    """

    topics: frozenset[str] = frozenset()
    regex: str = ''
    exclude_topics: frozenset[str] = frozenset()
    exclude_regex: str = ''

    def wants(self, topic: str) -> bool:
        """Tell whether a topic is recorded; hidden ones only if they are named."""
        if topic in self.exclude_topics:
            return False
        if self.exclude_regex and re.search(self.exclude_regex, topic):
            return False
        if topic in self.topics:
            return True
        if self.regex:
            return bool(re.search(self.regex, topic))
        return not self.topics and not is_hidden(topic)


def is_hidden(topic: str) -> bool:
    """Tell whether a topic is one of those that ROS tools don't show unasked."""
    return any(part.startswith('_') for part in topic.split('/'))
