"""One HTML page about a bag: everything is in the file, nothing is fetched, no script runs."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path

from layered_cbf_ros.bags.inspection.bag_info import BagInfo
from layered_cbf_ros.bags.inspection.info_table import HEADINGS, by_type, overview, topic_cells
from layered_cbf_ros.bags.inspection.report_style import STYLE
from layered_cbf_ros.bags.inspection.survey import Survey
from layered_cbf_ros.bags.run.verdict import Verdict

CAPTIONS = {
    'trajectories': 'Who was where: paths fade towards the past, bodies are drawn at equal times.',
    'distances': 'Centre distance of each pair, beside the sum of their radii.',
    'barriers': 'Barrier functions of each pair; the safe set is where both are above zero.',
    'intervention': 'How far the safety filter moved each acceleration from the desired one.',
    'speeds': "Planned speed and the trunk's, a gait cycle's mean.",
    'torques': 'Largest torque of the joints of each kind, in each gait cycle.',
    'solve_times': 'How long each node computed for a tick, as it told itself.',
}
MARKS = {True: '<td class="ok">ok</td>', False: '<td class="bad">FAIL</td>', None: '<td></td>'}


def report_page(survey: Survey, verdict: Verdict | None, figures: Sequence[Path]) -> str:
    """Return the page.

    Args:
        survey: What is in the bag.
        verdict: On the run, None if the bag is of something else.
        figures: PNG files, which become part of the page.
    """
    title = Path(survey.info.path).resolve().name
    if survey.record.scenario is not None:
        title = survey.record.scenario.name
    parts = [f'<h1>{escape(title)}{_badge(verdict)}</h1>']
    if survey.record.scenario is not None:
        parts.append(f'<p class="lead">{escape(survey.record.scenario.description)}</p>')
    if verdict is not None and verdict.reasons:
        parts.append(_list('Why it is not passed', verdict.reasons))
    if survey.problems:
        parts.append(_list('What is wrong with the bag', survey.problems))
    parts += map(_figure, figures)
    if verdict is not None:
        parts.append(_summary(verdict))
    parts += [_overview(survey.info), _topics(survey.info)]
    return PAGE.format(title=escape(title), style=STYLE, body='\n'.join(parts))


PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<main>
{body}
</main>
</body>
</html>
"""


def _badge(verdict: Verdict | None) -> str:
    if verdict is None:
        return ''
    kind, word = ('good', 'passed') if verdict.passed else ('poor', 'not passed')
    return f' <span class="badge {kind}">{word}</span>'


def _list(heading: str, lines: Sequence[str]) -> str:
    entries = ''.join(f'<li>{escape(line)}</li>' for line in lines)
    return f'<section class="alert"><h2>{heading}</h2><ul>{entries}</ul></section>'


def _figure(path: Path) -> str:
    data = base64.b64encode(path.read_bytes()).decode()
    caption = escape(CAPTIONS.get(path.stem, path.stem))
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
        f'<figcaption>{caption}</figcaption></figure>'
    )


def _summary(verdict: Verdict) -> str:
    rows = [
        f'<tr><th scope="row">{escape(check.figure)}</th><td>{escape(check.value)}</td>'
        f'<td>{escape(check.must)}</td>{MARKS[check.kept]}</tr>'
        for check in verdict.checks
    ]
    heading = '<tr><th>figure</th><th>value</th><th>must</th><th></th></tr>'
    return _table('The run', heading, rows)


def _overview(info: BagInfo) -> str:
    rows = [
        f'<tr><th scope="row">{name}</th><td>{escape(value)}</td></tr>'
        for name, value in overview(info)
    ]
    return _table('The bag', '', rows)


def _topics(info: BagInfo) -> str:
    rows = []
    for kind, topics in by_type(info.topics):
        rows.append(f'<tr class="kind"><th colspan="6">{escape(kind or "unknown type")}</th></tr>')
        for topic in topics:
            numbers = ''.join(f'<td class="number">{cell}</td>' for cell in topic_cells(topic))
            name, offered = escape(topic.name), escape(topic.offered)
            rows.append(f'<tr><th scope="row">{name}</th>{numbers}<td>{offered}</td></tr>')
    labels = ''.join(f'<th class="number">{heading}</th>' for heading in HEADINGS)
    return _table('Topics', f'<tr><th>topic</th>{labels}<th>offered</th></tr>', rows)


def _table(title: str, heading: str, rows: Sequence[str]) -> str:
    return (
        f'<section><h2>{title}</h2><div class="wide"><table>'
        f'<thead>{heading}</thead><tbody>{"".join(rows)}</tbody></table></div></section>'
    )
