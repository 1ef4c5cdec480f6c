"""The documents agree with the code: all targets exist, and nothing is missing."""

from __future__ import annotations

import ast
import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from aerarm_msgs_py.topics import TOPICS
from aerarm_ros.executables import command_modules
from aerarm_ros.hardware.bridge_modes import ACTIONS, MODES

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
# The changelog names what was removed.
PAGES = sorted([*DOCS.rglob('*.md'), *ROOT.glob('*.md')], key=str)
PAGES.remove(ROOT / 'CHANGELOG.md')
LINK = re.compile(r'\[[^\]]*\]\(([^)\s]+)\)')
CODE_FILE = re.compile(r'`([a-z_0-9]+(?:/[a-z_0-9.]+)+\.(?:py|yaml|xml|urdf|rviz|json))`')


@pytest.fixture(scope='module')
def reference() -> ModuleType:
    path = DOCS / 'generate_parameters.py'
    spec = importlib.util.spec_from_file_location('generate_parameters', path)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def anchors(page: Path) -> set[str]:
    """Return the anchors that a forge gives to a page's headings."""
    headings = re.findall(r'^#+ (.*)$', page.read_text(), flags=re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', text.lower()).replace(' ', '-') for text in headings}


def test_links_lead_somewhere() -> None:
    for page in PAGES:
        for target in LINK.findall(page.read_text()):
            if target.startswith(('http://', 'https://')):
                continue
            path, _, anchor = target.partition('#')
            found = (page.parent / path).resolve() if path else page
            assert found.exists(), (page, target)
            assert not anchor or anchor in anchors(found), (page, target)


def test_files_named_in_code_style_exist() -> None:
    for page in PAGES:
        for name in CODE_FILE.findall(page.read_text()):
            if not name.startswith(('output/', 'first_result/', 'result/')):
                found = [(ROOT / room / name).exists() for room in ('', 'aerarm_ros')]
                assert any(found), (page, name)


def test_every_page_can_be_reached_from_the_index() -> None:
    linked = {
        (DOCS / target).resolve() for target in LINK.findall((DOCS / 'README.md').read_text())
    }
    assert set(DOCS.rglob('*.md')) - {DOCS / 'README.md', DOCS / 'index.md'} <= linked


def test_every_executable_has_a_section(reference: ModuleType) -> None:
    page = (DOCS / 'reference' / 'executables.md').read_text()
    sections = set(re.findall(r'^## (\w+)$', page, flags=re.MULTILINE))
    assert sections >= set(command_modules())


def test_every_topic_mode_and_service_is_described() -> None:
    page = (DOCS / 'reference' / 'topics.md').read_text()
    for name in (*TOPICS, *MODES):
        assert f'`{name}`' in page, name
    for action in ACTIONS:
        assert f'`~/{action}`' in page


def test_the_graphs_name_every_mode_and_existing_nodes(reference: ModuleType) -> None:
    modes, nodes = ((DOCS / 'images' / f'{name}.svg').read_text() for name in ('modes', 'nodes'))
    assert {name for name in MODES if f'>{name}</text>' not in modes} == set()
    drawn = set(
        re.findall(r'\b[a-z0-9]+_[a-z_]+\b', ' '.join(re.findall(r'>([^<]+)</text>', nodes)))
    )
    assert drawn <= {*command_modules(), *TOPICS, *ACTIONS}
    assert {'hardware_bridge', 'joint_command'} <= drawn


def test_every_launch_file_and_argument_is_described() -> None:
    page = (DOCS / 'how-to' / 'drive_it.md').read_text()
    for path in (ROOT / 'launch').glob('*.launch.py'):
        assert f'`{path.name}`' in page
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == (
                'DeclareLaunchArgument'
            ):
                assert f'`{node.args[0].value}`' in page


def test_the_parameter_page_is_up_to_date(
    reference: ModuleType, ros_domain: dict[str, str]
) -> None:
    assert reference.PAGE.read_text() == reference.page(), 'run: python docs/generate_parameters.py'


GIVEN = re.compile(r'(?<![\w.~])(?P<name>[a-z][a-z_.]*[a-z]):=(?P<value>"[^"]*"|[^\s`)]*)')


def launch_arguments() -> set[str]:
    """Return the arguments on the drive-it page, which another test compares with the files."""
    return set(re.findall(r'`(\w+)`', (DOCS / 'how-to' / 'drive_it.md').read_text()))


def test_parameters_in_the_text_exist_and_may_have_that_value(
    reference: ModuleType, ros_domain: dict[str, str]
) -> None:
    tables = {name: reference.parameters_of(name) for name in command_modules()}
    known = [parameter for table in tables.values() for parameter in table]
    other = launch_arguments()
    wrong = []
    for page in PAGES:
        for given in GIVEN.finditer(page.read_text()):
            name, value = given['name'], given['value'].strip('"')
            named = [parameter for parameter in known if parameter.name == name]
            choices = {str(choice) for parameter in named for choice in parameter.choices}
            if not named and name not in other or choices and value not in choices:
                wrong.append(f'{page.relative_to(ROOT)}: {name}:={value}')
    assert not wrong


def test_the_arm_that_is_worked_out_is_the_one_that_is_shipped() -> None:
    page = (DOCS / 'how-to' / 'your_arm.md').read_text()
    examples = ROOT / 'config' / 'examples'
    (urdf,) = re.findall(r'^```xml\n(.*?)^```$', page, flags=re.MULTILINE | re.DOTALL)
    assert urdf == (examples / 'three_joints.urdf').read_text()
    (shown,) = re.findall(r'^```yaml\n(.*?)^```$', page, flags=re.MULTILINE | re.DOTALL)
    shipped = (examples / 'three_joints.yaml').read_text().splitlines()
    assert {line for line in shown.splitlines() if line} <= set(shipped)
