"""What the package says of itself is true, and it installs the same way everywhere."""

import ast
import os
import re
import runpy
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import setuptools
from packaging.markers import Marker
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / 'layered_cbf_ros'
PYTHONS = ('3.10', '3.11', '3.12')
# rosdep keys of what is imported under another name
KEYS = {
    'PIL': 'python3-pil',
    'coal': 'coal',
    'lz4': 'python3-lz4',
    'matplotlib': 'python3-matplotlib',
    'mcap': 'python3-mcap-pip',
    'numpy': 'python3-numpy',
    'proxsuite': 'proxsuite',
    'pinocchio': 'pinocchio',
    'pybullet': 'python3-pybullet-pip',
    'pybullet_data': 'python3-pybullet-pip',
    'pybullet_utils': 'python3-pybullet-pip',
    'rosbags': 'python3-rosbags-pip',
    'yaml': 'python3-yaml',
    'zstandard': 'python3-zstandard',
}
# extras that a person installs when they want them
OPTIONAL = {'aiohttp': 'viewer', 'imageio_ffmpeg': 'video', 'pyarrow': 'parquet', 'viser': 'viewer'}
DISTRIBUTIONS = {
    'PIL': 'pillow',
    'coal': 'pin',
    'imageio_ffmpeg': 'imageio-ffmpeg',
    'pinocchio': 'pin',
    'pybullet_data': 'pybullet',
    'pybullet_utils': 'pybullet',
    'yaml': 'pyyaml',
}

sys.path.insert(0, str(ROOT / 'scripts'))
import environment  # noqa: E402
import installation  # noqa: E402


@pytest.fixture(scope='module')
def setup_arguments():
    """Return what setup.py passes to setuptools."""
    arguments = {}
    original, folder = setuptools.setup, Path.cwd()
    setuptools.setup = lambda **given: arguments.update(given)
    try:
        os.chdir(ROOT)
        runpy.run_path('setup.py')
    finally:
        setuptools.setup = original
        os.chdir(folder)
    return arguments


@pytest.fixture(scope='module')
def manifest():
    return ElementTree.parse(ROOT / 'package.xml').getroot()


def imports(path):
    """Return the names of the modules that a file imports, inside functions too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return found


def imported_modules():
    """Return the top-level modules of others that the package imports."""
    found = {name.split('.')[0] for path in PACKAGE.rglob('*.py') for name in imports(path)}
    return found - set(sys.stdlib_module_names) - {'layered_cbf_ros'} - set(OPTIONAL)


def published_types():
    """Return the message types that nodes send, and the two that rclpy sends for each node.

    A type that is sent is handed on, as an argument or in a tuple; others are only called.
    """
    found = {'rcl_interfaces/msg/Log', 'rcl_interfaces/msg/ParameterEvent'}
    for path in (PACKAGE / 'nodes').glob('*.py'):
        nodes = list(ast.walk(ast.parse(path.read_text())))
        calls = [node.args for node in nodes if isinstance(node, ast.Call)]
        tuples = [node.elts for node in nodes if isinstance(node, ast.Tuple)]
        handed_on = {it.id for group in calls + tuples for it in group if isinstance(it, ast.Name)}
        for node in nodes:
            if isinstance(node, ast.ImportFrom) and node.module.endswith('.msg'):
                names = {alias.name for alias in node.names} & handed_on
                found |= {f'{node.module.replace(".", "/")}/{name}' for name in names}
    return found


def test_package_xml_names_what_is_imported_or_recorded_and_nothing_else(manifest):
    declared = {tag.text for kind in ('depend', 'exec_depend') for tag in manifest.iter(kind)}
    imported = {KEYS.get(module, module) for module in imported_modules()}
    assert declared == imported | {name.partition('/')[0] for name in published_types()}


def test_there_is_a_schema_of_every_type_that_is_published_and_of_no_other():
    schemas = {
        str(path.relative_to(ROOT / 'msg_schemas').with_suffix(''))
        for path in (ROOT / 'msg_schemas').rglob('*.msg')
    }
    assert schemas == published_types()


@pytest.mark.parametrize('name', ['environment', 'installation', 'starting'])
def test_the_scripts_do_not_import_each_other_in_a_circle(name):
    files = {path.stem: path for path in (ROOT / 'scripts').glob('*.py')}
    reached, waiting = set(), {name}
    while waiting:
        new = imports(files[waiting.pop()]) & set(files) - reached
        reached |= new
        waiting |= new
    assert name not in reached


def test_setup_py_requires_what_is_imported_beside_ros(setup_arguments):
    required = {Requirement(text).name for text in setup_arguments['install_requires']}
    modules = {module for module in imported_modules() if module in KEYS}
    assert required == {DISTRIBUTIONS.get(module, module) for module in modules}


def test_what_is_optional_is_an_extra_and_the_tests_have_it(setup_arguments):
    extras = setup_arguments['extras_require']
    for module, extra in OPTIONAL.items():
        assert DISTRIBUTIONS.get(module, module) in extras[extra]
        assert DISTRIBUTIONS.get(module, module) in extras['test']


def test_both_manifests_tell_the_same(manifest, setup_arguments):
    assert manifest.find('name').text == setup_arguments['name']
    assert manifest.find('version').text == setup_arguments['version']
    assert manifest.find('license').text == setup_arguments['license'] == 'Apache-2.0'
    assert 'Apache License' in (ROOT / 'LICENSE').read_text()
    assert manifest.find('export/build_type').text == 'ament_python'


def test_every_program_is_a_node_and_every_node_with_a_main_is_a_program(setup_arguments):
    points = setup_arguments['entry_points']['console_scripts']
    programs = {}
    for point in points:
        name, target = point.split(' = ')
        programs[name] = target
    files = {
        path.stem for path in (PACKAGE / 'nodes').glob('*.py') if 'def main()' in path.read_text()
    }
    assert set(programs) == files
    assert programs == {name: f'layered_cbf_ros.nodes.{name}:main' for name in files}


def test_every_parameter_file_and_schema_is_installed(setup_arguments):
    installed = {file for _, files in setup_arguments['data_files'] for file in files}
    for folder in ('params', 'msg_schemas'):
        for path in (ROOT / folder).rglob('*'):
            assert path.is_dir() or str(path.relative_to(ROOT)) in installed
    targets = {file: target for target, files in setup_arguments['data_files'] for file in files}
    assert targets['package.xml'] == 'share/layered_cbf_ros'
    index = 'share/ament_index/resource_index/packages'
    assert targets['resource/layered_cbf_ros'] == index


def pins(python):
    """Return the pinned version of each distribution for a Python."""
    found = {}
    for line in (ROOT / 'scripts' / 'constraints.txt').read_text().splitlines():
        text = line.partition('#')[0].strip()
        if not text:
            continue
        requirement = Requirement(text)
        marker = requirement.marker or Marker('python_version >= "3"')
        if marker.evaluate({'python_version': python}):
            name = re.sub('[-_.]+', '-', requirement.name).lower()
            assert name not in found, f'{name} is pinned twice for Python {python}'
            found[name] = str(requirement.specifier)
    return found


@pytest.mark.parametrize('python', PYTHONS)
def test_whatever_is_required_is_pinned_once_on_every_python(setup_arguments, python):
    extras = setup_arguments['extras_require']
    for text in [*setup_arguments['install_requires'], *extras['ros'], *extras['test']]:
        requirement = Requirement(text)
        pin = pins(python)[requirement.name]
        assert requirement.specifier.contains(pin.removeprefix('=='))


def test_the_environment_is_renewed_when_what_it_is_made_from_changes(tmp_path, monkeypatch):
    for name in ('setup.py', 'setup.cfg', 'scripts/constraints.txt', 'scripts/installation.py'):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes((ROOT / name).read_bytes())
    monkeypatch.setattr(environment, 'ROOT', tmp_path)
    before = environment.fingerprint({})
    (tmp_path / environment.STAMP).write_text(before)
    assert environment.is_ready(tmp_path, environment.fingerprint({}))
    with (tmp_path / 'scripts' / 'constraints.txt').open('a') as file:
        file.write('anything==1\n')
    assert not environment.is_ready(tmp_path, environment.fingerprint({}))


def test_programs_run_on_fast_dds_on_this_machine_alone():
    run = environment.run_variables({'PATH': '/bin', 'RMW_IMPLEMENTATION': 'x'}, Path('/v'))
    assert run['RMW_IMPLEMENTATION'] == 'rmw_fastrtps_cpp'
    assert run['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    assert run['OMP_NUM_THREADS'] == '1'
    assert run['AMENT_PREFIX_PATH'] == '/v'
    kept = environment.run_variables({'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}, Path('/v'))
    assert kept['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'SUBNET'


def test_library_paths_of_another_environment_are_not_passed_on():
    """The ROS wheels set both variables; one without the other breaks the import."""
    left = {'_ROS_WHEELS_BOOTSTRAP_COMPLETE': '1', 'LD_LIBRARY_PATH': '/other/lib'}
    run = environment.run_variables(left, Path('/v'))
    assert not set(left) & set(run)
    own = environment.run_variables({'LD_LIBRARY_PATH': '/cuda'}, Path('/v'))
    assert own['LD_LIBRARY_PATH'] == '/cuda'


def sourced_jazzy(folder, *modules):
    for name in modules:
        (folder / name).mkdir()
    return {
        'ROS_DISTRO': 'jazzy',
        'PYTHONPATH': str(folder),
        'AMENT_PREFIX_PATH': '/opt/ros/jazzy',
        'LD_LIBRARY_PATH': '/opt/ros/jazzy/lib:/cuda',
    }


def test_a_complete_jazzy_is_used_whole(tmp_path):
    variables = sourced_jazzy(tmp_path, 'rclpy', 'pinocchio', 'proxsuite')
    assert environment.jazzy_is_complete(variables)
    assert not environment.jazzy_is_complete({**variables, 'ROS_DISTRO': 'humble'})
    run = environment.run_variables(variables, Path('/v'))
    assert run['AMENT_PREFIX_PATH'].split(os.pathsep) == ['/v', '/opt/ros/jazzy']
    assert run['PYTHONPATH'] == str(tmp_path)
    assert run['LD_LIBRARY_PATH'] == variables['LD_LIBRARY_PATH']


def test_of_an_incomplete_jazzy_nothing_is_mixed_into_the_wheels(tmp_path):
    run = environment.run_variables(sourced_jazzy(tmp_path, 'rclpy'), Path('/v'))
    assert run['AMENT_PREFIX_PATH'] == '/v'
    assert 'PYTHONPATH' not in run
    assert run['LD_LIBRARY_PATH'] == '/cuda'


def test_an_old_python_is_refused_in_one_line(monkeypatch):
    monkeypatch.setattr(installation, 'probe', lambda python: None)
    with pytest.raises(environment.SetupError, match=r'Python 3\.10, 3\.11 or 3\.12 is needed'):
        installation.choose_python(jazzy=False)


@pytest.mark.parametrize(
    ('facts', 'compiler', 'remedy'),
    [
        (((3, 12), False, True), '/usr/bin/g++', r'apt install python3\.12-venv'),
        (((3, 12), True, True), None, r'apt install g\+\+'),
        (((3, 12), True, False), '/usr/bin/g++', r'apt install python3\.12-dev'),
    ],
)
def test_what_is_missing_is_told_before_minutes_are_lost(monkeypatch, facts, compiler, remedy):
    monkeypatch.setattr(installation, 'probe', lambda python: facts)
    monkeypatch.setattr(
        installation.shutil, 'which', lambda name: compiler if name.endswith('+') else None
    )
    with pytest.raises(environment.SetupError, match=remedy):
        installation.choose_python(jazzy=False)


def test_a_python_with_wheels_goes_before_one_that_must_compile(monkeypatch):
    facts = {'/p/python3.10': ((3, 10), True, True)}
    monkeypatch.setattr(
        installation, 'probe', lambda python: facts.get(python, ((3, 12), True, True))
    )
    monkeypatch.setattr(installation.shutil, 'which', lambda name: f'/p/{name}')
    assert installation.choose_python(jazzy=False) == '/p/python3.10'


@pytest.mark.parametrize(
    ('log', 'words'),
    [
        ("NewConnectionError('...: Temporary failure in name resolution')", 'no network'),
        ('ERROR: Could not find a version ... (from versions: none)', 'out of reach'),
        ('OSError: [Errno 28] No space left on device', 'disk is full'),
        ('something else', 'pip failed'),
    ],
)
def test_a_failure_of_pip_is_put_in_words(log, words):
    assert words in installation.meaning(log)


class FakeMachine:
    """Stands for Python, pip and the disk below an installation; pip may be interrupted."""

    def __init__(self, monkeypatch):
        self.commands = []
        self.interrupted = False
        monkeypatch.setattr(installation, 'probe', lambda python: ((3, 11), True, True))
        monkeypatch.setattr(installation.subprocess, 'run', self._run)
        monkeypatch.setattr(installation, 'run_pip', self._pip)
        monkeypatch.setattr(installation, 'lay_out', lambda venv: None)

    def _run(self, command, **_):
        self.commands.append(command[1:-1])
        python = Path(command[-1], 'bin', 'python')
        python.parent.mkdir(exist_ok=True)
        python.touch()
        return subprocess.CompletedProcess(command, 0, '', '')

    def _pip(self, venv, jazzy):
        self.commands.append(['pip'])
        if self.interrupted:
            raise KeyboardInterrupt


MAKE = ['-m', 'venv', '--clear']


def test_an_interrupted_setup_is_not_taken_for_done_and_begins_anew(tmp_path, monkeypatch):
    machine = FakeMachine(monkeypatch)
    machine.interrupted = True
    with pytest.raises(KeyboardInterrupt):
        installation.install(tmp_path, 'wanted', jazzy=False)
    assert not environment.is_ready(tmp_path, 'wanted')
    machine.interrupted = False
    installation.install(tmp_path, 'wanted', jazzy=False)
    assert environment.is_ready(tmp_path, 'wanted')
    assert machine.commands == [MAKE, ['pip'], MAKE, ['pip']]


def test_a_sound_environment_is_brought_up_to_date_in_place(tmp_path, monkeypatch):
    machine = FakeMachine(monkeypatch)
    installation.install(tmp_path, 'old', jazzy=False)
    installation.install(tmp_path, 'new', jazzy=False)
    installation.install(tmp_path, 'new', jazzy=False)  # as one that had to wait finds it
    assert machine.commands == [MAKE, ['pip'], ['pip']]
