"""Rooms within rooms: named after the steps of a flow, in an order that imports follow."""

import ast
import re
from pathlib import Path

import pytest
from source_files import (
    ROOT,
    SUITE,
    imported_modules,
    modules_in,
    package_folders,
    python_files,
    rooms_offered_by,
)

# The rooms inside a room, in the order in which its `__init__.py` names them: each may import from
# those before it only. Modules beside the inner rooms are doors, which may import all of them and
# which none of them imports.
INNER_ROOMS = {
    outer: rooms_offered_by(outer)
    for outer in (
        'aerarm_ros/control',
        'aerarm_ros/excitation',
        'aerarm_ros/hardware',
        'aerarm_ros/identification',
        'aerarm_ros/ros',
        'aerarm_msgs_py',
    )
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
    if folder == 'aerarm_ros/nodes':  # a list of executables, and no story
        return
    assert len(modules_in(folder)) <= MOST_MODULES


@pytest.mark.parametrize('folder', sorted(package_folders()))
def test_a_room_says_what_comes_in_and_what_goes_out(folder: str) -> None:
    if folder in ('aerarm_ros', 'aerarm_ros/nodes'):  # the house, and its doors
        return
    text = ast.get_docstring(ast.parse((ROOT / folder / '__init__.py').read_text())) or ''
    text = ' '.join(text.split())
    assert re.search(r'\b[Ii]n comes?\b', text)
    assert re.search(r'\bgo(es)? out\b|\bout go(es)?\b', text)


def test_no_two_classes_have_one_name() -> None:
    places: dict[str, list[str]] = {}
    for path in [
        file for folder in (*SUITE, 'test', 'benchmarks') for file in python_files(folder)
    ]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ClassDef) and node.name != 'TestShutdown':  # of launch_testing
                places.setdefault(node.name, []).append(str(path.relative_to(ROOT)))
    assert {name: files for name, files in places.items() if len(files) > 1} == {}
