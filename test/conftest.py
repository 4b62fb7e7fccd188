"""Markers of the tests."""

import pytest


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line('markers', 'system: starts real processes, against the clock; slow')
    config.addinivalue_line(
        'markers', 'lockstep: starts real processes that wait for each other; slow'
    )
