"""The schemas in msg_schemas/ are those of ROS 2 Jazzy."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from layered_cbf_ros.bags.storage.schemas import load_schema
from layered_cbf_ros.errors import BagError

ROOT = Path(__file__).resolve().parents[1]
STORED = ROOT / 'msg_schemas'
TYPES = sorted(json.loads((STORED / 'type_hashes.json').read_text()))


def interfaces_installed() -> bool:
    prefixes = [*os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep), sys.prefix]
    return any((Path(p) / 'share/sensor_msgs/msg/JointState.json').is_file() for p in prefixes if p)


@pytest.mark.skipif(not interfaces_installed(), reason='no ROS interface packages are installed')
def test_stored_schemas_are_the_installed_ones(tmp_path):
    """The generator run here gives every file as it is stored, and no other."""
    script = ROOT / 'scripts' / 'generate_msg_schemas'
    subprocess.run([sys.executable, script, tmp_path], check=True, capture_output=True, timeout=60)
    made = {p.relative_to(tmp_path): p.read_text() for p in tmp_path.rglob('*') if p.is_file()}
    stored = {p.relative_to(STORED): p.read_text() for p in STORED.rglob('*') if p.is_file()}
    assert made == stored


@pytest.mark.parametrize('type_name', TYPES)
def test_type_hash_follows_from_the_definition(type_name):
    """rosbags, parsing the text alone, arrives at the hash that ROS generated."""
    schema = load_schema(type_name)
    typestore = get_typestore(Stores.EMPTY)
    typestore.register(get_types_from_msg(schema.definition, type_name))
    assert typestore.hash_rihs01(type_name) == schema.type_hash


@pytest.mark.skipif(not interfaces_installed(), reason='no ROS interface packages are installed')
@pytest.mark.parametrize(
    'type_name',
    ['sensor_msgs/msg/PointCloud2', 'visualization_msgs/msg/MarkerArray', 'nav_msgs/msg/Path'],
)
def test_other_types_are_defined_by_their_installed_package(type_name):
    """rosbags, parsing the text alone, arrives at the hash that ROS generated."""
    schema = load_schema(type_name)
    typestore = get_typestore(Stores.EMPTY)
    typestore.register(get_types_from_msg(schema.definition, type_name))
    assert typestore.hash_rihs01(type_name) == schema.type_hash


def test_a_type_that_is_not_installed_is_refused_with_a_remedy():
    with pytest.raises(BagError, match=r"'no_such_msgs/msg/Thing'.*install package no_such_msgs"):
        load_schema('no_such_msgs/msg/Thing')
