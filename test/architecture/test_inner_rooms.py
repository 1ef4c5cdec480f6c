"""Rooms within rooms: named after the steps of a flow, in an order that imports follow."""

from pathlib import Path

import pytest
from source_files import ROOT, imported_modules, modules_in, package_folders, python_files

# The rooms inside a room, in order: each may import from those before it only. Modules beside
# the inner rooms are doors, which may import all of them and which none of them imports.
INNER_ROOMS = {
    'aerarm_ros/control': (
        'checks',
        'base',
        'references',
        'compensation',
        'laws',
    ),
    'aerarm_ros/excitation': (
        'settings',
        'trajectory',
        'clearance',
        'feasibility',
        'planning',
        'design',
        'player',
        'preview',
    ),
    'aerarm_ros/hardware': (
        'frames',
        'transports',
        'gate',
        'boards',
        'emulation',
    ),
    'aerarm_ros/identification': (
        'recording',
        'conditioning',
        'parameters',
        'regression',
        'solvers',
        'model_choice',
        'assessment',
        'payload',
        'files',
        'report',
        'motor_bench',
    ),
    'aerarm_ros/ros': (
        'parameters',
        'process',
        'executors',
        'graph',
        'diagnostics',
        'states',
        'bridge',
        'emulation',
        'requests',
        'controllers',
        'playback',
        'recording',
        'page',
        'programs',
    ),
    'aerarm_msgs_py': (
        'codecs',
        'live_topics',
        'bags',
    ),
}
MOST_MODULES = 20


def imports_from(path: Path, outer: str) -> set[str]:
    """Return what a file imports from an outer room: first the names below it, as 'report'."""
    prefix = f'{outer.replace("/", ".")}.'
    names = imported_modules(path)
    return {name.removeprefix(prefix).split('.')[0] for name in names if name.startswith(prefix)}


@pytest.mark.parametrize('outer', sorted(INNER_ROOMS))
def test_every_inner_room_has_its_place(outer: str) -> None:
    inner = {path.parent.name for path in (ROOT / outer).glob('*/__init__.py')}
    assert sorted(INNER_ROOMS[outer]) == sorted(inner)


@pytest.mark.parametrize(
    ('outer', 'room'), [(outer, room) for outer, rooms in INNER_ROOMS.items() for room in rooms]
)
def test_imports_between_inner_rooms_point_one_way(outer: str, room: str) -> None:
    order = INNER_ROOMS[outer]
    allowed = {*order[: order.index(room)], room}
    for path in python_files(f'{outer}/{room}'):
        assert imports_from(path, outer) <= allowed, path


def test_every_room_with_rooms_inside_has_an_order() -> None:
    outer = {str(Path(folder).parent) for folder in package_folders() if '/' in folder}
    assert outer == {*INNER_ROOMS, 'aerarm_ros'}


@pytest.mark.parametrize('folder', sorted(package_folders()))
def test_a_folder_tells_its_story_with_few_modules(folder: str) -> None:
    assert len(modules_in(folder)) <= MOST_MODULES
