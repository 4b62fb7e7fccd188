"""Strict reading of a YAML text: every refusal names file, line, field, value and remedy."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Iterable
from typing import Any, NoReturn

import yaml

from layered_cbf_ros.errors import ScenarioError

_ROS_NAME = re.compile(r'[A-Za-z](_?[A-Za-z0-9])*')


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return "did you mean 'x'? " if a known word is near, else nothing."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"did you mean '{near[0]}'? " if near else ''


class Entry:
    """One node of a YAML document, with the name of its field.

    Attributes:
        field: Where it is, as in `robots[0].position`.
    """

    def __init__(self, source: str, node: yaml.Node, field: str, line: int) -> None:
        """Wrap a node; `source` is the file's name, `line` that of the field's key."""
        self._source, self._node, self.field, self._line = source, node, field, line

    def refuse(self, remedy: str, what: str | None = None) -> NoReturn:
        """Raise the error of this entry; `what` is wrong with it, or its value is."""
        what = f'is {self._text()}' if what is None else what
        raise ScenarioError(
            f'{self._source}:{self._line}: {self.field or "the file"} {what}; {remedy}'
        )

    def mapping(self, required: Iterable[str], optional: Iterable[str] = ()) -> dict[str, Entry]:
        """Return the entries of a mapping, whose keys must be these."""
        required, entries = list(required), self.open_mapping()
        known = [*required, *optional]
        for key, entry in entries.items():
            if key not in known:
                entry.refuse(
                    f'{suggestion(key, known)}known here are {", ".join(known)}',
                    'is an unknown key',
                )
        for key in required:
            if key not in entries:
                self._child(key, self._node).refuse('add it', 'is missing')
        return entries

    def open_mapping(self) -> dict[str, Entry]:
        """Return the entries of a mapping with any keys."""
        if not isinstance(self._node, yaml.MappingNode):
            self.refuse('give a mapping, one `key: value` a line')
        entries: dict[str, Entry] = {}
        for key_node, value_node in self._node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                self.refuse('use plain words as keys', 'has a strange key')
            entry = self._child(key_node.value, value_node, key_node)
            if key_node.value in entries:
                entry.refuse('keep one of them', 'is given twice')
            entries[key_node.value] = entry
        return entries

    def entries(self) -> list[Entry]:
        """Return the entries of a list."""
        if not isinstance(self._node, yaml.SequenceNode):
            self.refuse('give a list')
        return [
            Entry(self._source, node, f'{self.field}[{k}]', node.start_mark.line + 1)
            for k, node in enumerate(self._node.value)
        ]

    def at(self, *path: str | int) -> Entry:
        """Return the entry at a path of keys and indices, or the last one there is."""
        entry = self
        for step in path:
            below: dict[Any, Entry] = {}
            if isinstance(entry._node, yaml.SequenceNode):
                below = dict(enumerate(entry.entries()))
            elif isinstance(entry._node, yaml.MappingNode):
                below = dict(entry.open_mapping())
            if step not in below:
                break
            entry = below[step]
        return entry

    def one_of(self, known: Iterable[str]) -> tuple[str, Entry]:
        """Return the only key of a mapping, and its entry."""
        known = list(known)
        entries = self.mapping((), known)
        if len(entries) != 1:
            self.refuse(f'give exactly one of {", ".join(known)}')
        return next(iter(entries.items()))

    def number(
        self, minimum: float = -math.inf, maximum: float = math.inf, unit: str = ''
    ) -> float:
        """Return a finite number in a closed range."""
        number = self._parse(float, f'give a number {unit}'.rstrip())
        if not math.isfinite(number):
            self.refuse('give a finite number')
        if not minimum <= number <= maximum:
            self.refuse(f'keep it in [{minimum:g}, {maximum:g}] {unit}'.rstrip())
        return number

    def positive(self, unit: str = '') -> float:
        """Return a finite number above zero."""
        number = self.number(unit=unit)
        if number <= 0.0:
            self.refuse(f'give a number above 0 {unit}'.rstrip())
        return number

    def whole(self, minimum: int, maximum: int) -> int:
        """Return a whole number in a closed range."""
        number = self._parse(int, 'give a whole number')
        if not minimum <= number <= maximum:
            self.refuse(f'keep it in [{minimum}, {maximum}]')
        return number

    def numbers(self, count: int, unit: str = '') -> tuple[float, ...]:
        """Return a list of finite numbers."""
        if not isinstance(self._node, yaml.SequenceNode) or len(self._node.value) != count:
            self.refuse(f'give a list of {count} numbers {unit}'.rstrip())
        return tuple(entry.number(unit=unit) for entry in self.entries())

    def point(self) -> tuple[float, float]:
        """Return a point of the plane [m]."""
        x, y = self.numbers(2, '[m]')
        return x, y

    def text(self) -> str:
        """Return a text."""
        if not isinstance(self._node, yaml.ScalarNode) or not self._is_text():
            self.refuse('give a text (in quotes, if it looks like something else)')
        return str(self._node.value)

    def word(self, known: Iterable[str]) -> str:
        """Return one of the known words."""
        known, word = list(known), self.text()
        if word not in known:
            self.refuse(f'{suggestion(word, known)}choose one of {", ".join(known)}')
        return word

    def yes_or_no(self) -> bool:
        """Return a truth value."""
        value = self.value()
        if not isinstance(value, bool):
            self.refuse('give true or false')
        return value

    def ros_name(self) -> str:
        """Return a name that ROS takes as a namespace."""
        name = self.text()
        if not _ROS_NAME.fullmatch(name):
            self.refuse('use letters, digits and single underscores, a letter first')
        return name

    def value(self) -> Any:
        """Return a parameter's value: true or false, a number, a text, or a list of these."""
        if isinstance(self._node, yaml.SequenceNode):
            return [entry.value() for entry in self.entries()]
        if not isinstance(self._node, yaml.ScalarNode) or self._tag() == 'null':
            self.refuse('give a number, a text, true or false, or a list of these')
        if self._tag() == 'bool':
            return self._node.value.lower() in ('true', 'yes', 'on')
        if self._node.style is None:
            for kind in (int, float):
                try:
                    return kind(self._node.value)
                except ValueError:
                    continue
        return self._node.value

    def _parse(self, kind: Callable[[str], Any], remedy: str) -> Any:
        """Read a plain scalar: YAML 1.1 takes 1e-3 for a text and 1:30 for a number."""
        if not isinstance(self._node, yaml.ScalarNode) or self._node.style is not None:
            self.refuse(remedy)
        try:
            return kind(self._node.value)
        except ValueError:
            self.refuse(remedy)

    def _is_text(self) -> bool:
        return self._node.style is not None or self._tag() == 'str'

    def _tag(self) -> str:
        return str(self._node.tag).rpartition(':')[2]

    def _child(self, key: str, node: yaml.Node, key_node: yaml.Node | None = None) -> Entry:
        field = f'{self.field}.{key}' if self.field else key
        line = self._line if key_node is None else key_node.start_mark.line + 1
        return Entry(self._source, node, field, line)

    def _text(self) -> str:
        if isinstance(self._node, yaml.MappingNode):
            return 'a mapping' if self._node.value else 'an empty mapping'
        if isinstance(self._node, yaml.SequenceNode):
            return f'a list of {len(self._node.value)}'
        return repr(self._node.value) if self._node.value else 'empty'


def read_document(text: str, source: str) -> Entry:
    """Return the root of a YAML text.

    Args:
        text: The YAML text.
        source: Name of its file, for messages.

    Raises:
        ScenarioError: If it isn't YAML, or is empty.
    """
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = mark.line + 1 if mark else 1
        raise ScenarioError(f'{source}:{line}: not YAML: {error.problem}; mend it') from None
    except (yaml.YAMLError, RecursionError) as error:
        reason = ' '.join(str(error).split())
        raise ScenarioError(f'{source}: not YAML: {reason}; mend it') from None
    if node is None:
        raise ScenarioError(f'{source}: the file is empty; start from template.yaml')
    return Entry(source, node, '', 1)
