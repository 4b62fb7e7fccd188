"""How the package is built and what it installs; `package.xml` says the same to ROS."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'layered_cbf_ros'
EXECUTABLES = (
    'a1_driver',
    'a1_emulator',
    'audit',
    'coordinator',
    'ground_force_mpc',
    'inspect',
    'obstacle_tracker',
    're_solve',
    'recorder',
    'replay',
    'simulator',
    'state_estimator',
    'supervisor',
    'teleop',
    'viewer',
    'whole_body_controller',
)


def shared(folder: str) -> list[tuple[str, list[str]]]:
    """Return where each file of a source folder goes below `share/`."""
    folders = [Path(folder), *(path for path in Path(folder).rglob('*') if path.is_dir())]
    return [
        (f'share/{NAME}/{path}', sorted(str(file) for file in path.iterdir() if file.is_file()))
        for path in sorted(folders)
    ]


setup(
    name=NAME,
    version='0.1.0',
    description='Safety-critical coordination of legged robots among moving obstacles, on ROS 2',
    author='The layered_cbf_ros authors',
    maintainer='The layered_cbf_ros authors',
    maintainer_email='layered-cbf-ros@users.noreply.github.com',
    license='Apache-2.0',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={NAME: ['viewing/front/page/*']},
    python_requires='>=3.10',
    install_requires=[
        'lz4',
        'matplotlib',
        'mcap',
        'numpy',
        'pillow',
        'pin>=3.4',
        'proxsuite>=0.7',
        'pybullet>=3.2.5',
        'pyyaml',
        'rosbags>=0.10',
        'zstandard',
    ],
    extras_require={
        # Where no ROS 2 Jazzy is installed: its client library and messages as wheels.
        'ros': ['ros-jazzy-rclpy', 'ros-jazzy-rmw-fastrtps-cpp', 'ros-jazzy-common-interfaces'],
        # For `inspect --export parquet`.
        'parquet': ['pyarrow'],
        # For the page in the browser.
        'viewer': ['aiohttp', 'viser'],
        # For `inspect --video` as mp4; GIF needs nothing.
        'video': ['imageio-ffmpeg'],
        'test': [
            *('aiohttp', 'imageio-ffmpeg', 'mcap-ros2-support', 'mypy', 'playwright'),
            *('pyarrow', 'pytest', 'pytest-xdist', 'ruff', 'viser'),
        ],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        *shared('params'),
        *shared('msg_schemas'),
    ],
    entry_points={
        'console_scripts': [f'{name} = {NAME}.nodes.{name}:main' for name in EXECUTABLES],
    },
    zip_safe=False,
)
