"""Markers of the tests."""

import pytest


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line('markers', 'system: starts real processes; slow')
