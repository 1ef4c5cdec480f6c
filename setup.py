"""Build description for both `colcon build` (ament_python) and `pip install`."""

import os
from glob import glob
from pathlib import Path

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.install_lib import install_lib

PACKAGE = 'aerarm_ros'

# Every bound has an upper end: a new major version is tried before it is let in.
RUN_TIME = [
    'argcomplete>=3.1,<4',
    'clarabel>=0.9,<0.12',
    'cryptography>=41,<60',
    'jinja2>=3.1,<4',
    'lazy-loader>=0.4,<1',
    'lz4>=4,<5',
    'mcap>=1.6,<2',
    'mujoco>=3.1,<5',
    'plotly>=5.18,<8',
    'pyyaml>=6,<7',
    'rosbags>=0.11,<0.12',
    'scipy>=1.11,<2',
    'zstandard>=0.22,<1',
]

# The message modules of an apt ROS are built against NumPy 1.26. Pinocchio's wheels ask for
# NumPy 2, so beside such a ROS Pinocchio comes from apt as well (ros-jazzy-pinocchio).
if os.environ.get('ROS_DISTRO') == 'jazzy':
    RUN_TIME += ['numpy>=1.26,<2']
else:
    RUN_TIME += ['numpy>=1.26,<3', 'pin>=3.3,<5']

# The 3-D view in a browser.
VIEW = ['viser>=1.1,<2']

# ROS 2 Jazzy for hosts without ROS (x86-64 Linux only). rclpy does not pull in
# an rmw implementation by itself, so Fast DDS is named.
ROS_WHEELS = [
    'ros-jazzy-common-interfaces>=5.3,<5.4',
    'ros-jazzy-rclpy>=7.1,<7.2',
    'ros-jazzy-rmw-fastrtps-cpp>=8.4,<8.5',
]

# The documentation site (`make docs`).
DOCS = [
    'furo>=2024.8.6',
    'myst-parser>=4,<6',
    'numpydoc>=1.8,<2',
    'sphinx>=8,<9',
    'sphinx-copybutton>=0.5.2,<1',
]

# Each file of `nodes` and `nodes/controllers` is a command.
EXECUTABLES = sorted(path.stem for path in Path(PACKAGE, 'nodes').rglob('[a-z]*.py'))


# What the bridge runs in every millisecond, and nothing that waits, reads files or knows ROS.
# It is machine code where AERARM_COMPILE=1 asks for it, by mypyc, of the same sources.
COMPILED = [
    'bridge_cycle',
    'fault_watch',
    'heat_watch',
    'boards/board_link',
    'boards/board_monitor',
    'boards/encoder_monitor',
    'boards/motor_references',
    'frames/board_messages',
    'gate/command_intake',
    'gate/joint_barrier',
    'gate/safety_gate',
]


def compiled() -> list[Extension]:
    """Return what is to be compiled: nothing, unless AERARM_COMPILE=1."""
    if os.environ.get('AERARM_COMPILE', '0') in ('', '0'):
        return []
    try:
        from mypyc.build import mypycify
    except ImportError:
        raise SystemExit(
            "AERARM_COMPILE: mypyc is not installed: pip install 'mypy>=1.8,<3', and pass "
            '--no-build-isolation to pip install, so that pip finds it'
        ) from None
    # Not by the rules of `make lint`: types of NumPy and others differ from version to version, and
    # their stubs need not be there.
    rules = ['--config-file=', '--ignore-missing-imports', '--follow-imports=silent']
    paths = [f'{PACKAGE}/hardware/{module}.py' for module in COMPILED]
    extensions: list[Extension] = mypycify([*rules, *paths])
    for extension in extensions:
        # A Pi could multiply and add in one step, which rounds otherwise than Python does.
        extension.extra_compile_args.append('-ffp-contract=off')
    return extensions


class BuildMachineCode(build_ext):
    """Builds what is compiled, but not among sources that somebody edits."""

    def finalize_options(self) -> None:
        """Refuse a build that would be left beside the sources."""
        super().finalize_options()
        if self.inplace and self.extensions:
            raise SystemExit(
                'AERARM_COMPILE: an editable installation would keep running the machine code of '
                'today after changes of the sources: remove --symlink-install or --editable'
            )


class InstallPackages(install_lib):
    """Installs the packages, without what an installation before it has compiled."""

    def install(self) -> list[str]:
        """Copy what was built; machine code comes before sources where Python looks."""
        for module in COMPILED:
            for stale in glob(f'{self.install_dir}/{PACKAGE}/hardware/{module}.*.so'):
                os.remove(stale)
        return super().install()


def share(*parts: str) -> str:
    """Return the install folder of shared files, where `ros2 launch` looks."""
    return '/'.join(('share', PACKAGE, *parts))


setup(
    name=PACKAGE,
    version='0.3.0',
    description='ROS 2 suite for a light four-joint aerial manipulator',
    license='Apache-2.0',
    author='aerarm_ros developers',
    maintainer='aerarm_ros developers',
    maintainer_email='aerarm@users.noreply.github.com',
    python_requires='>=3.11,<3.15',
    packages=find_packages(
        include=['aerarm_ros', 'aerarm_ros.*', 'aerarm_msgs_py', 'aerarm_msgs_py.*']
    ),
    # Templates of pages and models lie beside the modules that fill them in.
    package_data={'': ['py.typed', '*.html', '*.css', '*.js', '*.jinja']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (share(), ['package.xml']),
        (share('config'), glob('config/*.*')),
        (share('config', 'drones'), glob('config/drones/*.*')),
        (share('config', 'examples'), glob('config/examples/*.*')),
        (share('config', 'profiles'), glob('config/profiles/*.*')),
        (share('config', 'moveit'), glob('config/moveit/*.*')),
        (share('urdf'), glob('urdf/*.urdf')),
        (share('launch'), glob('launch/*.launch.py')),
        (share('rviz'), glob('rviz/*.*')),
    ],
    install_requires=RUN_TIME,
    extras_require={
        'ros': ROS_WHEELS,
        'spi': ['spidev>=3.5,<4'],
        'view': VIEW,
        'docs': DOCS,
        'mutants': ['mutmut>=3.8,<4'],
        'test': ['hypothesis', 'pytest'],
        'dev': [
            *VIEW,
            *DOCS,
            'example-robot-data>=4,<7',
            'hypothesis>=6,<7',
            'mypy>=1.8,<3',
            'pytest>=7.4,<10',
            'pytest-xdist>=3.5,<4',
            'ruff>=0.4,<1',
            'types-PyYAML>=6,<7',
        ],
    },
    zip_safe=False,
    ext_modules=compiled(),
    cmdclass={'build_ext': BuildMachineCode, 'install_lib': InstallPackages},
    entry_points={
        'console_scripts': [f'{name} = {PACKAGE}.executables:{name}' for name in EXECUTABLES]
    },
)
