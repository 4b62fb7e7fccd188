"""The house stands: arrows between the rooms run downwards only."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / 'layered_cbf_ros'
FILES = sorted(PACKAGE.rglob('*.py'))
LAYERS = ('coordination', 'ground_forces', 'whole_body')
CONTROL = (*LAYERS, 'perception')
NOT_IN_CONTROL = {'rclpy', 'time', 'logging', 'threading', 'asyncio', 'pathlib', 'os', 'socket'}


def room(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0]


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


@pytest.mark.parametrize('path', FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_only_nodes_know_rclpy(path):
    if room(path) != 'nodes':
        assert not any(name.split('.')[0] == 'rclpy' for name in imports(path))
        assert not any(name.startswith('layered_cbf_ros.nodes') for name in imports(path))


@pytest.mark.parametrize('layer', CONTROL)
def test_control_parts_know_no_clock_file_or_thread(layer):
    for path in (PACKAGE / layer).glob('*.py'):
        assert not {name.split('.')[0] for name in imports(path)} & NOT_IN_CONTROL, path


@pytest.mark.parametrize('layer', LAYERS)
def test_layers_do_not_import_each_other(layer):
    others = tuple(f'layered_cbf_ros.{other}' for other in LAYERS if other != layer)
    for path in (PACKAGE / layer).glob('*.py'):
        assert not any(name.startswith(others) for name in imports(path)), path


def test_no_file_tells_more_than_one_thing():
    """A file of more than 260 lines has outgrown its room."""
    lengths = {str(path): len(path.read_text().splitlines()) for path in FILES}
    assert not {path: lines for path, lines in lengths.items() if lines > 260}
