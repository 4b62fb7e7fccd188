"""What a recorder received and what it lost, topic by topic: as text, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields

from layered_cbf_ros.errors import BagError

NOTE = 'recorder'
"""Name of the note in a bag that tells of losses; it is in the last file."""
REFUSED_NOTE = 'recorder_refused'
"""Name of the note that tells, by topic, why one was not recorded."""


@dataclass(frozen=True, slots=True)
class TopicLosses:
    """What became of the messages of one topic.

    Attributes:
        received: Messages in the bag.
        lost: Messages sent while it was recorded and not received, by their numbers.
        missed_before: Messages sent before the recorder was connected to their publisher.
        repeated: Received with a stamp that was not newer than all before.
        stamp_gaps: Messages that seem absent by gaps between stamps. The second witness:
            it counts also what a publisher left out, and knows nothing of numbers.
    """

    received: int
    lost: int = 0
    missed_before: int = 0
    repeated: int = 0
    stamp_gaps: int = 0

    def text(self) -> str:
        """Return the figures as `name=value`, separated by spaces."""
        return ' '.join(f'{name}={value}' for name, value in asdict(self).items())


def note_of(losses: Mapping[str, TopicLosses]) -> dict[str, str]:
    """Return what is stored in a bag, by topic."""
    return {topic: figures.text() for topic, figures in losses.items()}


def read_losses(notes: Mapping[str, Mapping[str, str]]) -> dict[str, TopicLosses] | None:
    """Return losses by topic from the notes of a bag; None if its recorder told nothing.

    Raises:
        BagError: If the note is not of this form.
    """
    if NOTE not in notes:
        return None
    return {topic: _parsed(topic, text) for topic, text in notes[NOTE].items()}


def _parsed(topic: str, text: str) -> TopicLosses:
    known = {field.name for field in fields(TopicLosses)}
    try:
        values = {name: int(value) for name, _, value in (e.partition('=') for e in text.split())}
        return TopicLosses(**{name: value for name, value in values.items() if name in known})
    except (ValueError, TypeError):
        raise BagError(
            f"note '{NOTE}' of {topic} is '{text}'; expected received=N lost=N"
        ) from None


def table(losses: Mapping[str, TopicLosses]) -> list[str]:
    """Return a line for each topic, below a heading."""
    rows: list[Sequence[object]] = [('topic', 'received', 'lost', 'missed before', 'repeated')]
    rows += [
        (topic, each.received, each.lost, each.missed_before, each.repeated)
        for topic, each in sorted(losses.items())
    ]
    width = max(len(str(row[0])) for row in rows)
    return [f'{row[0]:<{width}}' + ''.join(f'{cell:>15}' for cell in row[1:]) for row in rows]


def summary(losses: Mapping[str, TopicLosses], refused: Sequence[str]) -> str:
    """Return one sentence on all topics."""
    total = {
        f.name: sum(getattr(each, f.name) for each in losses.values()) for f in fields(TopicLosses)
    }
    lossy = [topic for topic, each in sorted(losses.items()) if each.lost]
    lost = f'{total["lost"]} LOST on {", ".join(lossy)}' if lossy else 'nothing lost'
    sentence = f'{total["received"]} messages of {len(losses)} topics, {lost}'
    if total['missed_before']:
        sentence += f', {total["missed_before"]} sent before the recorder was there'
    if refused:
        sentence += f', NOT RECORDED: {", ".join(sorted(refused))}'
    return sentence
