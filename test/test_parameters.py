"""Parameter files and dataclasses say the same, and bad values are named."""

import dataclasses
import math

import pytest

from layered_cbf_ros.errors import ParameterError
from layered_cbf_ros.node_parameters import NODE_PARAMETERS
from layered_cbf_ros.parameters import from_mapping, parameter, parameters_of, read_parameter_file
from layered_cbf_ros.resources import find_folder
from layered_cbf_ros.timing import TimingParameters

OWN = [
    (node, cls)
    for node, kinds in NODE_PARAMETERS.items()
    for cls in kinds
    if cls is not TimingParameters
]


@pytest.mark.parametrize(('node', 'cls'), OWN)
def test_each_file_builds_its_dataclass_and_holds_its_defaults(node, cls):
    path = find_folder('params') / f'{node}.yaml'
    own = parameters_of(cls)
    values = {name: v for name, v in read_parameter_file(path)[node].items() if name in own}
    assert set(values) == set(own)
    assert from_mapping(cls, values) == cls()


@pytest.mark.parametrize(
    'cls', dict.fromkeys(cls for kinds in NODE_PARAMETERS.values() for cls in kinds)
)
def test_every_parameter_is_described(cls):
    for field in dataclasses.fields(cls):
        assert len(field.metadata['description']) > 3, field.name


def test_the_controllers_of_a_robot_agree_on_its_height_and_braking():
    mpc, wbc = (
        NODE_PARAMETERS[node][0]() for node in ('ground_force_mpc', 'whole_body_controller')
    )
    assert (mpc.com_height, mpc.braking) == (wbc.com_height, wbc.braking)


@dataclasses.dataclass(frozen=True)
class Example:
    gain: float = parameter(1.0, 'a gain', '1/s', 0.0, 10.0)
    count: int = parameter(3, 'a count', '', 1, 5)
    pair: tuple[float, float] = parameter((1.0, 2.0), 'a pair', 'm', 0.0)
    mode: str = parameter('a', 'a mode', choices=('a', 'b'))
    on: bool = parameter(True, 'a switch')


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'gian': 1.0}, "unknown parameter 'gian'; known are count, gain"),
        ({'gain': 11.0}, r'gain is 11; keep it in \[0, 10\] 1/s'),
        ({'gain': math.nan}, 'gain is nan'),
        ({'gain': '1'}, "gain is '1'; give a number"),
        ({'gain': True}, 'gain is True; give a number'),
        ({'count': 2.5}, 'count is 2.5; give a whole number'),
        ({'pair': [1.0]}, r'pair is \[1.0\]; give a list of 2'),
        ({'pair': [1.0, -1.0]}, 'pair is -1; keep it in'),
        ({'mode': 'c'}, "mode is 'c'; choose one of a, b"),
        ({'on': 1}, 'on is 1; give true or false'),
    ],
)
def test_a_bad_value_is_named_with_its_remedy(values, words):
    with pytest.raises(ParameterError, match=words):
        from_mapping(Example, values)


def test_whole_numbers_are_numbers():
    assert from_mapping(Example, {'gain': 2, 'pair': [1, 2]}).gain == 2.0
