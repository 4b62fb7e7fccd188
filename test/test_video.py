"""Videos of runs: what is where in a picture, which instants are shown, and what is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pytest
from inspecting import Inspector
from PIL import Image
from synthetic_bag import Recipe, write_bag

from layered_cbf_ros.errors import BagError
from layered_cbf_ros.robot_model import RobotModel
from layered_cbf_ros.scenario import Wall
from layered_cbf_ros.viewing.history import History
from layered_cbf_ros.viewing.palette import ROBOTS, barrier_colour
from layered_cbf_ros.viewing.robot_shape import RobotShape
from layered_cbf_ros.viewing.sight.bag_sight import BagSight
from layered_cbf_ros.viewing.sight.snapshot import (
    BallSight,
    BarrierSight,
    ObstacleSight,
    RobotSight,
    Snapshot,
)
from layered_cbf_ros.viewing.solids import cylinder
from layered_cbf_ros.viewing.video.camera import NEAR, Camera, cut_in_front
from layered_cbf_ros.viewing.video.file import shown_fps, write_video
from layered_cbf_ros.viewing.video.frame import Frame
from layered_cbf_ros.viewing.video.frames import VideoWish, aim_at, frames
from layered_cbf_ros.viewing.video.renderer import Renderer
from layered_cbf_ros.viewing.video.shading import TO_LIGHT, facets

SIZE = 640, 360
STANDING = RobotModel().nominal_configuration(np.zeros(2), 0.0)
EXIT_BAD = 2


def robot(x, y, yaw=0.0, name='a1_0', **changes):
    configuration = STANDING.copy()
    configuration[:2] += x, y
    configuration[3:7] = 0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw)
    sight = RobotSight(
        name, configuration, np.zeros(2), np.zeros((4, 3)), np.zeros((4, 3)), True, 0.3, None,
        np.zeros(2), np.array([x, y, 0.0]), 0.0, False, False,
    )  # fmt: skip
    return replace(sight, **changes)


def obstacle(x, y, radius=0.3, height=1.0):
    return ObstacleSight('cart', np.array([x, y]), np.zeros(2), radius, height, False)


@pytest.fixture(scope='module')
def drawn():
    """Return a function that draws a snapshot, without the panels at the edges."""
    renderer = Renderer()

    def draw(snapshot, target=(0.0, 0.0), distance=5.0):
        camera = Camera(np.array(target), distance, *SIZE)
        picture = renderer.draw(Frame(snapshot, camera, History(), 1.0))
        assert picture.size == SIZE
        return camera, np.asarray(picture, dtype=float)

    return draw


def where(pixels, colour, least=0.75):
    """Return the pixels whose hue is a colour's: along it from black, or towards white."""
    colour = np.array(colour, dtype=float)
    flat = pixels - pixels.min(axis=2, keepdims=True)
    pure = colour - colour.min()
    size = np.linalg.norm(flat, axis=2)
    alike = flat @ pure / np.maximum(size * np.linalg.norm(pure), 1e-9)
    rows, columns = np.nonzero((alike > 0.99) & (size > least * np.linalg.norm(pure) * 0.6))
    return np.column_stack((columns, rows))


def trunk_pixels(pixels, colour):
    """Leave out the panel of figures and the legend."""
    found = where(pixels, colour)
    inside = (found[:, 1] > 105) & (found[:, 1] < SIZE[1] - 25)
    return found[inside]


def test_a_camera_sees_as_a_pinhole_does():
    """Oracle: the ray from its position to a point, cut with the picture's plane."""
    camera = Camera(np.array([1.0, -2.0]), 6.0, *SIZE)
    eye = camera.position
    look = np.array([1.0, -2.0, 0.0]) - eye
    look /= np.linalg.norm(look)
    right = np.cross(look, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    up = np.cross(right, look)
    assert np.linalg.norm(eye - [1.0, -2.0, 0.0]) == pytest.approx(6.0)
    rng = np.random.default_rng(3)
    for point in rng.uniform((-2.0, -4.0, 0.0), (4.0, 0.0, 1.0), (20, 3)):
        ray = (point - eye) / ((point - eye) @ look)
        expected = 320.0 + camera.focal_length * ray @ right, 180.0 - camera.focal_length * ray @ up
        assert camera.project(point) == pytest.approx(expected, abs=1e-9)
        assert camera.depth(point) == pytest.approx((point - eye) @ look)
    assert camera.project(np.array([1.0, -2.0, 0.0])) == pytest.approx([320.0, 180.0])


def test_what_is_behind_the_camera_is_cut_off():
    camera = Camera(np.zeros(2), 2.0, *SIZE)
    far, behind = [0.0, 30.0, 0.0], [0.0, -30.0, 0.0]
    square = np.array([[-1.0, *behind[1:]], [1.0, *behind[1:]], [1.0, *far[1:]], [-1.0, *far[1:]]])
    kept = cut_in_front(camera, square)
    assert len(kept) == 4
    assert camera.depth(kept).min() == pytest.approx(NEAR)
    assert cut_in_front(camera, square - (0.0, 100.0, 0.0)).shape == (0, 3)


def test_surfaces_face_outwards():
    """By the divergence theorem a closed surface has a volume, positive if it faces outwards."""
    body = facets(cylinder(), (1, 2, 3))
    a, b, c = body.corners.transpose(1, 0, 2)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    middle = body.corners.mean(axis=1)
    volume = (area * np.einsum('ij,ij->i', middle, body.normals)).sum() / 3.0
    assert volume == pytest.approx(np.pi, rel=0.01)  # 40 flat sides, rounded edge


@pytest.mark.parametrize(('x', 'y'), [(0.0, 0.0), (1.0, 0.6), (-0.8, -0.5)])
def test_a_robot_is_drawn_where_it_is(drawn, x, y):
    camera, pixels = drawn(Snapshot(0, (robot(x, y),)))
    found = trunk_pixels(pixels, ROBOTS[0])
    assert len(found) > 200
    trunk = np.array([x, y, 0.28])
    near = 0.08 * camera.metre(trunk)  # 8 cm: of the trunk only the upper side is seen
    assert found.mean(axis=0) == pytest.approx(camera.project(trunk), abs=near)


def test_an_obstacle_hides_a_robot_behind_it_and_not_one_before_it(drawn):
    """The camera looks along +y: what has the smaller y is nearer."""
    alone = len(trunk_pixels(drawn(Snapshot(0, (robot(0.0, 0.0),)))[1], ROBOTS[0]))
    behind = Snapshot(0, (robot(0.0, 0.0),), (obstacle(0.0, -0.8, 0.4),))
    before = Snapshot(0, (robot(0.0, 0.0),), (obstacle(0.0, 0.8, 0.4),))
    assert len(trunk_pixels(drawn(behind)[1], ROBOTS[0])) < 0.1 * alone
    assert len(trunk_pixels(drawn(before)[1], ROBOTS[0])) > 0.9 * alone


def test_shadows_fall_away_from_the_light(drawn):
    """The shadow of a body's top lies where the ray of light through it hits the ground."""
    empty = drawn(Snapshot(0))[1]
    camera, pixels = drawn(Snapshot(0, (), (obstacle(0.0, 0.0, 0.1, 0.6),)))
    reach = -0.6 * 0.9 * TO_LIGHT[:2] / TO_LIGHT[2]
    for sign, darker in ((1.0, True), (-1.0, False)):
        column, row = camera.project(np.array([*(sign * reach), 0.0])).round().astype(int)
        assert (pixels[row, column].sum() < empty[row, column].sum() - 60) == darker


def test_a_base_without_legs_shows_where_it_is_heading(drawn):
    """The pale arrowhead on its disc is longer ahead of the centre than behind it."""
    for yaw in (0.0, np.pi):
        base = robot(0.0, 0.0, yaw, has_legs=False, radius=0.4)
        camera, pixels = drawn(Snapshot(0, (base,)), distance=3.0)
        top = camera.project(np.array([0.0, 0.0, 0.31]))
        row = round(float(top[1]))
        disc = pixels[row, int(top[0]) - 60 : int(top[0]) + 61]
        pale = np.nonzero(disc.min(axis=1) > 170)[0] - 60
        assert len(pale) > 10
        assert np.sign(pale.max() + pale.min()) == (1.0 if yaw == 0.0 else -1.0)


def test_a_fleet_without_legs_leaves_no_part_of_an_a1_to_be_placed():
    for positions, orientations in RobotShape().poses([]):
        assert (positions.shape, orientations.shape) == ((0, 3), (0, 4))


def test_h_goes_from_red_to_green():
    red, green, _ = np.array([barrier_colour(h) for h in np.linspace(-0.5, 2.0, 26)]).T
    assert barrier_colour(0.0) == barrier_colour(-3.0)
    assert barrier_colour(1.0) == barrier_colour(9.0)
    assert red[0] > 3 * green[0]
    assert green[-1] > 2 * red[-1]


def test_a_ball_has_the_colour_of_its_h(drawn):
    for h, reddish in ((0.05, True), (0.9, False)):
        ball = BallSight('a1_0~cart', np.zeros(2), 0.5, h)
        camera, pixels = drawn(Snapshot(0, balls=(ball,)))
        column, row = camera.project(np.array([0.05, 0.05, 0.0])).round().astype(int)
        red, green, _ = pixels[row, column]
        assert (red > green + 5) == reddish


def test_a_wall_forbids_the_side_behind_it(drawn):
    empty = drawn(Snapshot(0))[1]
    camera, pixels = drawn(Snapshot(0, walls=(Wall('left', (0.0, 0.7), (0.0, -1.0)),)))
    for y, shaded in ((0.9, True), (0.5, False)):
        column, row = camera.project(np.array([0.33, y, 0.0])).round().astype(int)
        assert (pixels[row, column].sum() < empty[row, column].sum() - 30) == shaded


def test_a_stop_is_told_across_the_top(drawn):
    running, stopped = (drawn(Snapshot(0, is_stopped=flag))[1] for flag in (False, True))
    banner = slice(10, 24), slice(255, 385)
    assert abs(stopped[banner] - running[banner]).mean() > 40.0
    assert abs(stopped[banner][..., 0] - stopped[banner][..., 1]).mean() > 60.0  # it is red


def test_the_camera_keeps_everybody_in_the_picture():
    wish = VideoWish(0.0, 1.0, 1.0, 10.0, *SIZE)
    rng = np.random.default_rng(5)
    for _ in range(30):
        robots = tuple(robot(*rng.uniform(-9.0, 9.0, 2), name=f'r{k}') for k in range(3))
        snapshot = Snapshot(0, robots, (obstacle(*rng.uniform(-9.0, 9.0, 2)),))
        x, y, distance = aim_at(snapshot, wish)
        camera = Camera(np.array([x, y]), distance, *SIZE)
        for it in robots:
            column, row = camera.project(it.configuration[:3])
            assert 0.0 < column < SIZE[0]
            assert 0.0 < row < SIZE[1]


def test_history_keeps_the_last_seconds_and_the_smallest_h():
    history = History()
    for k in range(400):
        pairs = BarrierSight('a', 2.0, 0.0, 0.0, 0.0), BarrierSight('b', 0.01 * k, 0.0, 0.0, 0.0)
        snapshot = Snapshot(k * 100_000_000, (robot(0.1 * k, 0.0),), barriers=pairs)
        history = history.after(snapshot)
    assert len(history.trail('a1_0')) == 61
    assert history.trail('a1_0')[-1, 0] - history.trail('a1_0')[0, 0] == pytest.approx(6.0)
    stamps, smallest = np.array(history.barriers).T
    assert stamps[-1] - stamps[0] == 20 * 10**9
    assert smallest == pytest.approx(np.minimum(2.0, stamps * 1e-10))


def test_what_a_bag_does_not_tell_is_left_out_of_the_picture(drawn):
    unknown = BarrierSight('a1_0~cart', np.nan, np.nan, np.nan, np.nan)
    ball = BallSight('a1_0~cart', np.full(2, np.nan), np.nan, np.nan)
    nothing = Snapshot(0, (robot(0.0, 0.0),), distances={})
    gaps = replace(nothing, barriers=(unknown,), balls=(ball,), distances={'a1_0~cart': np.nan})
    assert not History().after(gaps).barriers
    legend = slice(0, SIZE[1] - 25)  # which tells what balls mean
    assert np.array_equal(drawn(gaps)[1][legend], drawn(nothing)[1][legend])


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Two robots walk for two seconds."""
    return write_bag(tmp_path_factory.mktemp('video') / 'bag', Recipe())


def test_frames_are_as_far_apart_as_speed_and_rate_ask(bag):
    sight = BagSight(bag)
    wish = VideoWish(0.5, 1.5, 2.0, 10.0, *SIZE, follow='a1_1')
    shown = list(frames(sight, wish))
    assert len(shown) == wish.count == 6
    assert [frame.seconds for frame in shown] == pytest.approx([0.5, 0.7, 0.9, 1.1, 1.3, 1.5])
    walked = np.array([frame.snapshot.robots[1].configuration[0] for frame in shown])
    assert np.diff(walked) == pytest.approx(0.1, abs=2e-3)  # 0.5 m/s
    assert shown[0].camera.target == pytest.approx(shown[0].snapshot.robots[1].configuration[:2])
    assert len(shown[0].history.trail('a1_1')) > 4  # what was before the first picture


def plain_pictures(count, size=(160, 120)):
    for k in range(count):
        yield Image.new('RGB', size, (20 * k, 60, 200))


def test_an_mp4_holds_every_picture(tmp_path):
    import imageio_ffmpeg

    write_video(plain_pictures(9), tmp_path / 'out.mp4', 30.0)
    reader = imageio_ffmpeg.read_frames(str(tmp_path / 'out.mp4'))
    told = next(reader)
    assert told['source_size'] == (160, 120)
    assert told['fps'] == 30.0
    means = [np.frombuffer(data, np.uint8).reshape(120, 160, 3).mean((0, 1)) for data in reader]
    expected = [(20 * k, 60, 200) for k in range(9)]
    assert np.array(means) == pytest.approx(np.array(expected), abs=6.0)  # lossy, by 4:2:0


def test_a_gif_shows_every_picture_for_as_long_as_asked(tmp_path):
    """Pictures that are equal may become one, which then stays for longer."""
    fps = shown_fps(tmp_path / 'out.gif', 12.0)
    assert fps == pytest.approx(12.5)  # hundredths of a second: 8, not 8.33
    wanted = [0, 1, 1, 2, 3, 4, 5, 5, 6]
    pictures = [Image.new('RGB', (160, 120), (0, 60, 200)) for _ in wanted]
    for place, picture in zip(wanted, pictures, strict=True):
        picture.paste((255, 255, 255), (20 * place, 40, 20 * place + 20, 60))
    write_video(iter(pictures), tmp_path / 'out.gif', fps)
    shown = []
    with Image.open(tmp_path / 'out.gif') as film:
        for number in range(film.n_frames):
            film.seek(number)
            bright = np.nonzero(np.asarray(film.convert('L'))[50] > 200)[0]
            shown += [int(bright[0]) // 20] * (film.info['duration'] // 80)
    assert shown == wanted


@pytest.mark.parametrize('name', ['out.mp4', 'out.gif'])
def test_a_video_that_fails_half_way_leaves_nothing(tmp_path, name):
    (tmp_path / name).write_bytes(b'before')

    def failing():
        yield from plain_pictures(3)
        raise BagError('no more')

    with pytest.raises(BagError, match='no more'):
        write_video(failing(), tmp_path / name, 10.0)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() == b'before'


@pytest.fixture
def inspect(monkeypatch, capsys):
    return Inspector(monkeypatch, capsys)


def test_inspect_renders_a_bag(inspect, bag, tmp_path):
    out = tmp_path / 'run.gif'
    size = ('--size', '160x120', '--fps', '5', '--speed', '1', '--from', '0.4')
    ended = inspect(bag, '--video', out, *size)
    assert (ended.code, ended.err) == (0, '')
    assert f'{out}, 9 pictures' in ended.out
    with Image.open(out) as film:
        assert (film.size, film.n_frames) == ((160, 120), 9)
    assert 'exists already' in inspect(bag, '--video', out).problem


def test_a_bag_that_was_cut_off_is_rendered_as_far_as_it_goes(inspect, bag, tmp_path):
    (whole,) = bag.glob('*.mcap')
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])
    ended = inspect(cut, '--video', tmp_path / 'cut.gif', '--size', '160x120', '--speed', '1')
    assert ended.code == 0
    assert 'cut off' in ended.out
    assert (tmp_path / 'cut.gif').is_file()


@pytest.mark.parametrize(
    ('arguments', 'words'),
    [
        (('--video', 'x.avi'), ("'.avi'", '.mp4 or .gif')),
        (('--video', 'nowhere/x.gif'), ('no folder nowhere',)),
        (('--video', 'x.gif', '--from', '1.5', '--to', '0.5'), ('--from is 1.5', '--to is 0.5')),
        (('--video', 'x.gif', '--from', '7'), ('--from is 7', '2.0 s in the bag')),
        (('--video', 'x.gif', '--from', 'nan'), ('--from is nan',)),
        (('--video', 'x.gif', '--from', '-1'), ('--from is -1',)),
        (('--video', 'x.gif', '--follow', 'a1_9'), ("no robot 'a1_9'", 'a1_0, a1_1')),
        (('--video', 'x.gif', '--size', '640'), ('--size is 640', 'WIDTHxHEIGHT')),
        (('--video', 'x.gif', '--size', '641x360'), ('--size is 641x360', 'even')),
        (('--video', 'x.gif', '--fps', '0'), ('--fps is 0', 'above 0')),
        (('--video', 'x.gif', '--speed', 'inf'), ('--speed is inf', 'at most')),
        (('--video', 'x.gif', '--plot'), ('stands alone', '--plot')),
        (('--video', 'x.gif', '--start-offset', '1'), ('stands alone', '--start-offset')),
        (('--follow', 'a1_0'), ('--follow', '--video FILE')),
    ],
)
def test_a_bad_wish_is_one_line(inspect, bag, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    ended = inspect(bag, *arguments)
    assert ended.code == EXIT_BAD
    assert all(word in ended.problem for word in words), ended.problem
    assert not list(tmp_path.iterdir())


def test_without_an_encoder_the_remedy_is_told(inspect, bag, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'imageio_ffmpeg', None)
    ended = inspect(bag, '--video', tmp_path / 'x.mp4')
    assert ended.code == EXIT_BAD
    assert 'pip install imageio-ffmpeg' in ended.problem


def test_inspect_loads_nothing_of_the_renderer_unless_asked():
    code = (
        'import sys; import layered_cbf_ros.bags.inspection.command_line;'
        "print([m for m in sys.modules if m.split('.')[0] in ('pybullet', 'rclpy', 'viser')"
        " or m.startswith('layered_cbf_ros.viewing')])"
    )
    said = subprocess.run([sys.executable, '-c', code], capture_output=True, check=True, timeout=60)
    assert said.stdout.strip() == b'[]'


@pytest.mark.lockstep
def test_a_render_that_is_killed_leaves_no_half_video_and_no_process(bag, tmp_path):
    """SIGKILL, which nobody can handle, while pictures are being written."""
    code = 'from layered_cbf_ros.nodes.inspect import main; main()'
    command = [sys.executable, '-c', code, str(bag), '--video', str(tmp_path / 'x.mp4')]
    process = subprocess.Popen([*command, '--speed', '0.01'], stdout=subprocess.DEVNULL)
    while not any(path.stat().st_size for path in tmp_path.iterdir()):
        assert process.poll() is None
        time.sleep(0.05)
    children = descendants(process.pid)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert len(children) >= 2
    end = time.monotonic() + 30.0
    while any(os.path.exists(f'/proc/{pid}') for pid in children):
        assert time.monotonic() < end, 'an orphan lives on'
        time.sleep(0.05)
    assert not (tmp_path / 'x.mp4').exists()


def descendants(pid):
    """Return the process numbers of a process's children."""
    with open(f'/proc/{pid}/task/{pid}/children') as file:
        return [int(child) for child in file.read().split()]
