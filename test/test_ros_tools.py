"""What tools are given: markers, frames, a description they can follow, and ready layouts."""

from __future__ import annotations

import json
import math
import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import ModuleType
from urllib.parse import unquote, urlparse

import numpy as np
import pinocchio as pin
import pytest
import yaml
from geometry_msgs.msg import Transform
from rclpy.serialization import deserialize_message, serialize_message
from synthetic_bag import Recipe, write_bag
from test_video import obstacle, robot
from visualization_msgs.msg import Marker, MarkerArray

from layered_cbf_ros import node_topics
from layered_cbf_ros.bags.storage.decoding import MessageDecoder
from layered_cbf_ros.bags.storage.opening import open_bag
from layered_cbf_ros.interfaces import LEGS, PlannedMotion
from layered_cbf_ros.nodes.ros_tools import RosTools, transform_message_type
from layered_cbf_ros.robot_description import robot_description
from layered_cbf_ros.robot_model import RobotModel, find_urdf
from layered_cbf_ros.scenario import Wall
from layered_cbf_ros.viewing.links import Links
from layered_cbf_ros.viewing.palette import barrier_colour
from layered_cbf_ros.viewing.sight.snapshot import BallSight, Snapshot

PARAMS = Path(__file__).resolve().parents[1] / 'params'
STRING = 'std_msgs/msg/String'
TEAM = tuple(f'a1_{k}' for k in range(4))


class Outlet:
    """Stands for a publisher; keeps what is published while somebody listens."""

    def __init__(self):
        self.messages = []
        self.listeners = 1

    def publish(self, message):
        self.messages.append(message)

    def get_subscription_count(self):
        return self.listeners


class Outlets:
    """Stands for a node; its publishers by topic."""

    def __init__(self):
        self.by_topic = {}

    def create_publisher(self, message_type, topic, qos):
        self.by_topic[topic] = Outlet()
        return self.by_topic[topic]


@pytest.fixture
def outlets():
    return Outlets()


def world(**changes):
    """Return a snapshot with one of everything."""
    plan = PlannedMotion(0, np.array([1.0, 2.0]), np.array([0.3, -0.4]), np.zeros(2), 0.0, 0.0)
    forces = np.zeros((4, 3))
    forces[2] = 10.0, 0.0, 100.0
    feet = np.arange(12.0).reshape(4, 3)
    it = robot(
        1.0, 2.0, 0.5, plan=plan, target=np.array([0.5, 0.0]), foot_forces=forces,
        foot_positions=feet, reach=np.array([1.0, 2.0, 0.6]),
    )  # fmt: skip
    parts = {
        'robots': (it,),
        'obstacles': (obstacle(-1.0, 0.5, 0.25, 0.9),),
        'walls': (Wall('left', (0.0, 3.0), (0.0, -1.0)),),
        'balls': (BallSight('a1_0~cart', np.array([0.2, 0.1]), 0.7, 0.25),),
    }
    return Snapshot(2_500_000_000, **parts | changes)


def by_name(message, group):
    return [marker for marker in message.markers if marker.ns == group]


def test_markers_show_what_is_there_in_the_world_frame(outlets):
    message = RosTools(outlets).markers(world())
    assert {(m.header.frame_id, m.header.stamp.sec) for m in message.markers} == {('world', 2)}
    (cylinder,) = by_name(message, 'obstacles')
    assert cylinder.type == Marker.CYLINDER
    place, size = cylinder.pose.position, cylinder.scale
    assert (place.x, place.y, place.z) == (-1.0, 0.5, 0.45)
    assert (size.x, size.y, size.z) == (0.5, 0.5, 0.9)
    (ball,) = by_name(message, 'balls')
    red, green, blue = barrier_colour(0.25)
    shown = ball.color.r, ball.color.g, ball.color.b
    assert shown == pytest.approx((red / 255, green / 255, blue / 255), abs=1e-6)
    assert (ball.pose.position.x, ball.scale.x) == (0.2, 1.4)
    (reach,) = by_name(message, 'reachable_sets')
    assert (reach.pose.position.y, reach.scale.x) == (2.0, 1.2)
    assert {m.text for m in by_name(message, 'names')} == {'a1_0', 'cart'}
    assert all(m.color.a > 0.0 and m.lifetime.sec for m in message.markers)


def test_arrows_lead_where_the_motion_and_the_force_do(outlets):
    message = RosTools(outlets).markers(world())
    ends = {}
    for group in ('desired', 'safe', 'forces'):
        (arrow,) = by_name(message, group)
        assert arrow.type == Marker.ARROW
        a, b = ([p.x, p.y, p.z] for p in arrow.points)
        ends[group] = np.array(a), np.array(b) - np.array(a)
    assert ends['safe'][1] == pytest.approx([0.3, -0.4, 0.0])
    assert ends['desired'][1] == pytest.approx([0.5, 0.0, 0.0])
    start, way = ends['forces']
    assert start == pytest.approx([6.0, 7.0, 8.0])  # the third foot
    assert way / np.linalg.norm(way) == pytest.approx(np.array([0.1, 0.0, 1.0]) / math.sqrt(1.01))


@pytest.mark.parametrize('normal', [(0.0, -1.0), (1.0, 0.0), (0.6, 0.8)])
def test_the_box_of_a_wall_touches_the_allowed_side_and_does_not_enter_it(outlets, normal):
    wall = Wall('w', (1.0, 2.0), normal)
    (box,) = by_name(RosTools(outlets).markers(world(walls=(wall,))), 'walls')
    q, p = box.pose.orientation, box.pose.position
    turn = pin.Quaternion(np.array([q.x, q.y, q.z, q.w])).matrix()
    half = 0.5 * np.array([box.scale.x, box.scale.y, box.scale.z])
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    corners = np.array([p.x, p.y, p.z]) + (signs * half) @ turn.T
    along = (corners[:, :2] - wall.point) @ np.array(normal)
    assert along.max() == pytest.approx(0.0, abs=1e-9)
    assert along.min() == pytest.approx(-box.scale.y)


def test_a_shape_keeps_its_number_and_what_vanishes_is_deleted(outlets):
    tools = RosTools(outlets)
    first = tools.markers(world())
    other = obstacle(0.0, 0.0)
    more = tools.markers(world(obstacles=(other, *world().obstacles)))
    names = {m.text: m.id for m in by_name(first, 'names')}
    assert {m.text: m.id for m in by_name(more, 'names')} == names
    last = tools.markers(world(obstacles=(), balls=()))
    gone = {(m.ns, m.id) for m in last.markers if m.action == Marker.DELETE}
    kept = {(m.ns, m.id) for m in last.markers if m.action == Marker.ADD}
    before = {(m.ns, m.id) for m in more.markers}
    assert gone == before - kept
    assert {group for group, _ in gone} == {'obstacles', 'balls', 'names'}
    assert not [m for m in tools.markers(world(obstacles=(), balls=())).markers if m.action]


def test_numbers_are_never_used_twice_in_one_message(outlets):
    message = RosTools(outlets).markers(world())
    keys = [(m.ns, m.id) for m in message.markers]
    assert len(keys) == len(set(keys))
    back = deserialize_message(serialize_message(message), MarkerArray)
    assert len(back.markers) == len(keys)


def test_a_ball_that_is_not_known_is_not_shown(outlets):
    unknown = BallSight('a1_0~cart', np.full(2, np.nan), np.nan, np.nan)
    assert not by_name(RosTools(outlets).markers(world(balls=(unknown,))), 'balls')


def test_a_base_without_legs_is_a_disc_and_has_no_frames(outlets):
    base = robot(1.0, 0.0, has_legs=False, radius=0.4)
    tools = RosTools(outlets)
    (body,) = by_name(tools.markers(world(robots=(base,))), 'bodies')
    assert (body.type, body.scale.x) == (Marker.CYLINDER, 0.8)
    assert tools.transforms(world(robots=(base,))) == []


def test_nothing_is_made_while_nobody_listens(outlets):
    tools = RosTools(outlets)
    outlet = outlets.by_topic['/markers']
    outlet.listeners = 0
    tools.publish(world())
    assert not outlet.messages
    outlet.listeners = 1
    tools.publish(world())
    assert len(outlet.messages) == 1


def test_frames_lead_from_the_world_to_every_toe(outlets):
    """Chained through their parents they end where our model of the robot has its feet."""
    it = robot(1.0, -2.0, 0.7)
    it.configuration[7:] += np.random.default_rng(1).uniform(-0.2, 0.2, 12)
    model = RobotModel()
    model.update_kinematics(it.configuration, np.zeros(18))
    frames = {f.child_frame_id: f for f in RosTools(outlets).transforms(world(robots=(it,)))}
    assert {f.header.stamp.nanosec for f in frames.values()} == {500_000_000}

    def place(name):
        if name == 'world':
            return pin.SE3.Identity()
        t: Transform = frames[name].transform
        turn = pin.Quaternion(np.array([t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w]))
        here = pin.SE3(turn.matrix(), np.array([t.translation.x, t.translation.y, t.translation.z]))
        return place(frames[name].header.frame_id) * here

    for leg, foot in zip(LEGS, model.feet, strict=True):
        assert place(f'a1_0/{leg}_toe').translation == pytest.approx(foot, abs=1e-9)
    assert place('a1_0/trunk').translation == pytest.approx(it.configuration[:3])


def test_frames_are_the_links_of_the_description(outlets):
    """Tools look for exactly these, with the robot's name before them."""
    links = {link.get('name') for link in ElementTree.parse(find_urdf()).iter('link')}
    frames = {f.child_frame_id for f in RosTools(outlets).transforms(world())}
    assert frames == {f'a1_0/{link}' for link in links}
    joints = ElementTree.parse(find_urdf()).getroot().findall('joint')
    parents = {j.find('child').get('link'): j.find('parent').get('link') for j in joints}
    for pose in Links().tree(world().robots[0].configuration):
        assert pose.parent == parents.get(pose.link, '')


def test_frames_are_published_where_tf2_msgs_is_installed(outlets, monkeypatch):
    """The package isn't on PyPI: a stand-in with the one field that TFMessage has."""

    class TFMessage:
        def __init__(self, transforms):
            self.transforms = transforms

    package, messages = ModuleType('tf2_msgs'), ModuleType('tf2_msgs.msg')
    messages.TFMessage = TFMessage
    monkeypatch.setitem(sys.modules, 'tf2_msgs', package)
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', messages)
    assert transform_message_type() is TFMessage
    RosTools(outlets).publish(world())
    (message,) = outlets.by_topic['/tf'].messages
    assert message.transforms[0].header.frame_id == 'world'


def test_without_tf2_msgs_there_are_markers_alone(outlets, monkeypatch):
    monkeypatch.setitem(sys.modules, 'tf2_msgs', None)
    RosTools(outlets).publish(world())
    assert list(outlets.by_topic) == ['/markers']


def test_every_mesh_of_the_published_description_can_be_opened():
    root = ElementTree.fromstring(robot_description())
    addresses = [urlparse(mesh.get('filename')) for mesh in root.iter('mesh')]
    assert len(addresses) == 13
    assert {address.scheme for address in addresses} == {'file'}
    assert all(Path(unquote(address.path)).is_file() for address in addresses)
    published = pin.buildModelFromXML(robot_description(), pin.JointModelFreeFlyer())
    assert published == pin.buildModelFromUrdf(str(find_urdf()), pin.JointModelFreeFlyer())


@pytest.fixture(scope='module')
def recorded(tmp_path_factory):
    """Return type and first message of each topic of a run of many pairs, by topic."""
    recipe = Recipe(robots=(*TEAM, 'a1_4'), duration=0.1)
    bag = open_bag(write_bag(tmp_path_factory.mktemp('tools') / 'bag', recipe))
    decoder, found = MessageDecoder(), {}
    for record in bag.records():
        name = record.topic.name
        found.setdefault(name, (record.topic.type_name, decoder.decode(record)))
    found[node_topics.MARKERS] = ('visualization_msgs/msg/MarkerArray', None)
    for name in TEAM:
        found[f'/{name}/robot_description'] = (STRING, None)
    return found


def resolve(message, path):
    """Follow a path such as `points[0].positions[2]` into a message; return what is there."""
    for part in re.findall(r'[A-Za-z_]\w*|\[\d+\]', path):
        message = message[int(part[1:-1])] if part[0] == '[' else getattr(message, part)
    return message


def foxglove():
    return json.loads((PARAMS / 'foxglove.json').read_text())


def foxglove_paths():
    """Return every message path of the layout, with the panel it is for."""
    for panel, config in foxglove()['configById'].items():
        for key in ('topicPath', 'topicToRender'):
            if config.get(key):
                yield panel, config[key]
        yield from ((panel, series['value']) for series in config.get('paths', ()))


def test_every_path_of_the_foxglove_layout_leads_to_something(recorded):
    paths = list(foxglove_paths())
    assert len(paths) > 20
    for panel, path in paths:
        topic, _, rest = path.partition('.')
        _, message = recorded[topic]
        found = resolve(message, rest)
        assert not panel.startswith('Plot!') or isinstance(found, float), path


def test_the_foxglove_layout_places_each_panel_once():
    layout = foxglove()

    def leaves(node):
        if isinstance(node, str):
            return [node]
        assert node['direction'] in ('row', 'column')
        assert 0 < node['splitPercentage'] < 100
        return leaves(node['first']) + leaves(node['second'])

    assert sorted(leaves(layout['layout'])) == sorted(layout['configById'])
    assert {panel.partition('!')[0] for panel in layout['configById']} == {
        '3D', 'Plot', 'DiagnosticSummary', 'RawMessages',
    }  # fmt: skip


def test_the_foxglove_scene_shows_markers_and_every_robot(recorded):
    scene = foxglove()['configById']['3D!run']
    assert scene['topics'][node_topics.MARKERS]['visible']
    assert scene['followTf'] == 'world'
    models = [it for it in scene['layers'].values() if it['layerId'] == 'foxglove.Urdf']
    assert [it['framePrefix'] for it in models] == [f'{name}/' for name in TEAM]
    for it in models:
        assert it['sourceType'] == 'topic'
        assert recorded[it['topic']][0] == STRING


def test_the_rviz_layout_shows_markers_and_every_robot(recorded):
    layout = yaml.safe_load((PARAMS / 'rviz.rviz').read_text())['Visualization Manager']
    assert layout['Global Options']['Fixed Frame'] == 'world'
    displays = {it['Name']: it for it in layout['Displays']}
    assert all(it['Enabled'] for it in displays.values())
    markers = displays['Markers']
    assert markers['Class'] == 'rviz_default_plugins/MarkerArray'
    assert recorded[markers['Topic']['Value']][0] == 'visualization_msgs/msg/MarkerArray'
    for name in TEAM:
        it = displays[name]
        assert it['Class'] == 'rviz_default_plugins/RobotModel'
        assert it['TF Prefix'] == name
        assert recorded[it['Description Topic']['Value']][0] == STRING
        assert it['Description Topic']['Durability Policy'] == 'Transient Local'


def test_every_curve_of_the_plotjuggler_layout_leads_to_something(recorded):
    """Of a JointState a curve is named by the joint, of other messages by the path."""
    root = ElementTree.parse(PARAMS / 'plotjuggler.xml').getroot()
    chosen = [it.get('value').split(';') for it in root.iter('selected_topics')]
    assert chosen[0] == chosen[1]
    assert set(chosen[0]) <= set(recorded)
    curves = [curve.get('name') for curve in root.iter('curve')]
    assert len(curves) > 15
    for curve in curves:
        topic = max((t for t in chosen[0] if curve.startswith(f'{t}/')), key=len)
        kind, message = recorded[topic]
        path = curve[len(topic) + 1 :]
        if kind == 'sensor_msgs/msg/JointState':
            name, _, field = path.rpartition('/')
            assert field in ('position', 'velocity', 'effort')
            assert re.fullmatch(r'a1_\d~(a1_\d|obstacle_\d)|(FL|FR|RL|RR)_foot', name)
        else:
            assert isinstance(resolve(message, path.replace('/', '.')), float), curve


def test_the_plotjuggler_layout_is_as_large_as_it_says():
    root = ElementTree.parse(PARAMS / 'plotjuggler.xml').getroot()
    for splitter in root.iter('DockSplitter'):
        assert int(splitter.get('count')) == len(splitter)
        sizes = [float(size) for size in splitter.get('sizes').split(';')]
        assert len(sizes) == len(splitter)
        assert sum(sizes) == pytest.approx(1.0, abs=1e-5)
    plugins = {plugin.get('ID') for plugin in root.iter('plugin')}
    assert plugins == {'DataLoad ROS2 bags', 'ROS2 Topic Subscriber'}
    assert root.find('previouslyLoaded_Streamer').get('name') in plugins
