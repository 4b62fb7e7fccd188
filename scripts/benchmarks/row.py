"""One figure of the benchmark, and how it is shown."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

WIDTHS = (54, 15, 11, 11, 8)
HEADING = ('figure', 'value', 'must', 'stretch', '')


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes:
        figure, value, unit: What was measured.
        must, stretch: Largest value that is good enough, and that is aimed at.
        at_least: The limits are smallest values instead.
        physical: A missed must fails the benchmark; speed and memory never do.
        details: Other figures of the same measurement.
    """

    figure: str
    value: float
    unit: str = ''
    must: float | None = None
    stretch: float | None = None
    at_least: bool = False
    physical: bool = True
    details: dict[str, float] = field(default_factory=dict)

    def keeps(self, limit: float | None) -> bool | None:
        """Tell whether the value keeps a limit, None if there is none; NaN keeps nothing."""
        if limit is None:
            return None
        return bool(self.value >= limit if self.at_least else self.value <= limit)

    @property
    def fails(self) -> bool:
        """Tell whether the benchmark fails by this figure."""
        return self.physical and self.keeps(self.must) is False

    def line(self) -> str:
        """Return it as a line of the table."""
        sign = '>=' if self.at_least else '<='
        limits = ['' if x is None else f'{sign} {_text(x)}' for x in (self.must, self.stretch)]
        mark = 'MISSED' if self.keeps(self.must) is False else 'ok' if limits[0] else ''
        if self.keeps(self.stretch):
            mark = 'stretch'
        value = f'{_text(self.value)} {self.unit}'.rstrip()
        details = ', '.join(f'{name} {_text(x)}' for name, x in self.details.items())
        return table_line((self.figure, value, *limits, mark)) + (f'  ({details})' * bool(details))

    def to_json(self) -> dict[str, Any]:
        """Return it as plain values; what isn't finite becomes None."""
        plain = asdict(self) | {'must_kept': self.keeps(self.must)}
        plain['value'] = self.value if math.isfinite(self.value) else None
        return plain | {'stretch_kept': self.keeps(self.stretch)}


def table_line(cells: tuple[str, ...]) -> str:
    """Return cells as an aligned line."""
    return ' '.join(map(str.ljust, cells, WIDTHS))


def _text(value: float) -> str:
    return f'{value:.0f}' if 100.0 <= abs(value) < 1e9 else f'{value:.3g}'
