"""What is said and written at the end of a run."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from layered_cbf_ros.bags.figures.run_figures import draw_record
from layered_cbf_ros.bags.run.run_record import load_run
from layered_cbf_ros.bags.run.verdict import judge_record
from layered_cbf_ros.errors import BagError
from layered_cbf_ros.supervision.run_folder import RunFolder
from layered_cbf_ros.supervision.supervisor import Code, RunOutcome


def conclude(
    folder: RunFolder,
    outcome: RunOutcome,
    wall_time: float,
    copy: Path | None,
    say: Callable[[str], None],
) -> int:
    """Judge a run by its bag, write its summary, and return the exit code.

    Args:
        folder: The run's folder.
        outcome: How it ended.
        wall_time: From the first to the last simulated time [s].
        copy: Where the summary goes too, if not None.
        say: Prints text.
    """
    summary: dict[str, Any] = {
        'outcome': outcome.code.name.lower(),
        'reason': outcome.reason,
        'missing': list(outcome.missing),
        'run': str(folder.path),
    }
    passed = True
    if outcome.code is not Code.FINISHED:
        say(f'{outcome.code.name}: {outcome.reason}')
    if folder.recorded:
        try:
            record = load_run(folder.bag)
        except BagError as error:
            passed = False
            say(f'no verdict: {error}')
        else:
            verdict = judge_record(record, wall_time_s=wall_time)
            passed = verdict.passed
            summary |= verdict.to_json()
            say(verdict.table())
            figures = draw_record(record, folder.figures)
            say(f'{len(figures)} figures in {folder.figures}')
    code = int(outcome.code) or int(not passed)
    summary |= {'passed': code == 0, 'exit_code': code}
    text = json.dumps(summary, indent=2) + '\n'
    for path in filter(None, (folder.summary, copy)):
        path.write_text(text, encoding='utf-8')
    return code
