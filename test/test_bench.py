"""The benchmark prints a table that a person reads and JSON that a program reads."""

import json
import math
import os
import runpy
import signal
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).resolve().parents[1] / 'scripts'


@pytest.fixture
def bench(monkeypatch):
    """Return the benchmark, in this very environment."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    monkeypatch.setattr(sys, 'path', list(sys.path))
    main = runpy.run_path(str(SCRIPTS / 'bench'))['bench']
    return lambda *arguments: main(Path(sys.prefix), arguments)


@pytest.fixture
def row(monkeypatch):
    """Return the class of figures."""
    monkeypatch.syspath_prepend(str(SCRIPTS))
    from benchmarks.row import Row

    return Row


def test_figures_stand_in_the_table_and_in_the_file(bench, capsys, tmp_path):
    file = tmp_path / 'figures.json'
    assert bench('--only', 'accelerations', 'messages', '--json', str(file)) == 0
    heading, *lines, last = capsys.readouterr().out.splitlines()
    written = json.loads(file.read_text())
    assert heading.split() == ['figure', 'value', 'must', 'stretch']
    assert last == 'every physical must is kept'
    assert written['passed'] is True
    assert len(lines) == len(written['figures']) == 1 + 2 * 4
    for line, figure in zip(lines, written['figures'], strict=True):
        assert line.startswith(figure['figure'])
        assert line.index('<=') == heading.index('must') if figure['must'] else '<=' not in line
    exact, *speeds = written['figures']
    assert 0.0 < exact['value'] <= exact['stretch'] < exact['must']
    for speed in speeds:
        assert 0.0 < speed['value'] <= speed['details']['p99']
        assert speed['details']['calibrations'] > 0.0


def test_an_unknown_measurement_is_named(bench):
    with pytest.raises(SystemExit, match=r"no measurement 'trott'; there are physics: .*trot"):
        bench('--only', 'stand', 'trott')


@pytest.mark.parametrize(
    ('value', 'at_least', 'must', 'stretch'),
    [
        (0.5, False, True, True),
        (1.5, False, True, False),
        (2.5, False, False, False),
        (2.5, True, True, True),
        (0.5, True, False, False),
        (math.nan, False, False, False),
        (math.nan, True, False, False),
    ],
)
def test_limits_are_kept_or_missed(row, value, at_least, must, stretch):
    """Limits are 2 and 1; smallest values are both 1."""
    limits = (1.0, 1.0) if at_least else (2.0, 1.0)
    figure = row('x', value, 'm', *limits, at_least=at_least)
    assert (figure.keeps(figure.must), figure.keeps(figure.stretch)) == (must, stretch)
    assert figure.fails is not must
    assert ('MISSED' in figure.line()) is not must
    assert json.loads(json.dumps(figure.to_json(), allow_nan=False))['must_kept'] is must


def test_a_missed_speed_fails_nothing(row):
    slow = row('x', 3.0, 's', 2.0, 1.0, physical=False)
    assert 'MISSED' in slow.line()
    assert not slow.fails


def test_a_missed_physical_must_fails_the_benchmark(bench, row, monkeypatch, capsys):
    from benchmarks import physics

    tilted = row('stand: tilt', 9.0, 'deg', 3.0)
    monkeypatch.setitem(physics.PHYSICS, 'stand', lambda: [tilted])
    assert bench('--only', 'stand') == 1
    assert capsys.readouterr().out.endswith('missed: stand: tilt\n')


def test_all_processes_below_a_process_are_counted(row):
    from benchmarks import graph

    script = 'sh -c "sleep 20 & echo \\$!; wait" & wait'
    with subprocess.Popen(['sh', '-c', script], stdout=subprocess.PIPE, text=True) as shell:
        grandchild = int(shell.stdout.readline())
        family = graph.descendants(shell.pid)
        memory = graph.proportional_set(shell.pid)
        os.kill(grandchild, signal.SIGTERM)
    assert len(family) == 2
    assert family[-1] == grandchild
    assert 1e4 < memory < 1e8  # a shell
    assert graph.proportional_set(grandchild) == 0.0  # it has ended
