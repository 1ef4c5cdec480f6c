"""The documents agree with the code: all targets exist, and nothing is missing."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from source_files import parameter_page

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


def test_every_executable_has_a_section() -> None:
    page = (DOCS / 'reference' / 'executables.md').read_text()
    sections = set(re.findall(r'^## (\w+)$', page, flags=re.MULTILINE))
    assert sections >= set(command_modules())


def test_every_topic_mode_and_service_is_described() -> None:
    page = (DOCS / 'reference' / 'topics.md').read_text()
    for name in (*TOPICS, *MODES):
        assert f'`{name}`' in page, name
    for action in ACTIONS:
        assert f'`~/{action}`' in page


def test_the_graphs_name_every_mode_and_existing_nodes() -> None:
    modes, nodes = ((DOCS / 'images' / f'{name}.svg').read_text() for name in ('modes', 'nodes'))
    assert {name for name in MODES if f'>{name}</text>' not in modes} == set()
    drawn = set(
        re.findall(r'\b[a-z0-9]+_[a-z_]+\b', ' '.join(re.findall(r'>([^<]+)</text>', nodes)))
    )
    assert drawn <= {*command_modules(), *TOPICS, *ACTIONS}
    assert {'hardware_bridge', 'joint_command'} <= drawn


def test_the_parameter_page_is_up_to_date(ros_domain: dict[str, str]) -> None:
    reference = parameter_page()
    assert reference.PAGE.read_text() == reference.page(), 'run: python docs/generate_parameters.py'


GIVEN = re.compile(r'(?<![\w.~])(?P<name>[a-z][a-z_.]*[a-z]):=(?P<value>"[^"]*"|[^\s`)]*)')


def launch_arguments() -> set[str]:
    """Return the arguments on the drive-it page, which another test compares with the files."""
    return set(re.findall(r'`(\w+)`', (DOCS / 'how-to' / 'drive_it.md').read_text()))


def test_parameters_in_the_text_exist_and_may_have_that_value(ros_domain: dict[str, str]) -> None:
    tables = {name: parameter_page().parameters_of(name) for name in command_modules()}
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


QUOTING = 'how-to/faults.md', 'how-to/flight.md', 'faq.md'
COMMANDS = 'arm ', 'ros2 ', 'set ', 'make ', 'pip ', 'NODE: ', '-', 'imu_', 'sudo ', 'encoders: '
# Names, numbers and units, which a program fills in.
FILLED_IN = re.compile(r'\.\.\.|\b(?:joint|board)\d\b|[+-]?\d+(?:\.\d+)?|\{.*?\}')


def texts() -> str:
    """Return all texts in the sources, with a mark where a value is filled in."""
    found = []
    for path in (ROOT / 'aerarm_ros').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.JoinedStr):
                parts = [p.value if isinstance(p, ast.Constant) else '{}' for p in node.values]
                found.append(''.join(map(str, parts)))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return '\n'.join(' '.join(text.split()) for text in found)


def quoted(page: Path) -> list[str]:
    """Return quotations of several words, without commands."""
    found = re.findall(r'`([^`\n]+)`', page.read_text())
    return [text for text in found if ' ' in text and not text.startswith(COMMANDS)]


def test_quoted_messages_are_those_of_the_programs() -> None:
    said, missing = texts(), []
    for text in (text for page in QUOTING for text in quoted(ROOT / 'docs' / page)):
        pieces = [piece.strip(' ,:') for piece in FILLED_IN.split(text)]
        missing += [f'{text}: {p}' for p in pieces if len(p.split()) > 1 and p not in said]
    assert not missing, '\n'.join(missing)
