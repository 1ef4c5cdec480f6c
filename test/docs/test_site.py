"""The documentation site builds without a warning, and code in its pages works."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path

import pytest

from aerarm_ros.executables import command_modules
from aerarm_ros.nodes.arm import make_parser

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*(ROOT / 'docs').rglob('*.md'), *ROOT.glob('*.md')])
BLOCK = re.compile(r'^( *)```(\w+)\n(.*?)^ *```$', flags=re.MULTILINE | re.DOTALL)
# What a host brings; everything else that a page types belongs to this package.
HOST = {
    'adduser', 'cd', 'colcon', 'do', 'done', 'echo', 'export', 'for', 'git', 'mkdir', 'pip',
    'printf', 'python', 'python3', 'ros2', 'rosdep', 'rviz2', 'scp', 'source', 'sudo', 'usermod',
}  # fmt: skip


def blocks(page: Path, *languages: str) -> list[str]:
    """Return the code blocks of a page in one of some languages, without their indent."""
    found = []
    for indent, language, text in BLOCK.findall(page.read_text()):
        if language in languages:
            found.append('\n'.join(line.removeprefix(indent) for line in text.splitlines()))
    return found


def commands(text: str) -> list[list[str]]:
    """Return the words of each simple command of a shell block, without assignments before it."""
    text = re.sub(r"<<'?(\w+)'?\n.*?^\1$", '', text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r'(^|\s)#.*$', '', text.replace('\\\n', ' '), flags=re.MULTILINE)
    lexer = shlex.shlex(text, posix=True, punctuation_chars=';|&()<>\n')
    lexer.commenters, lexer.whitespace, lexer.whitespace_split = '', ' \t', True
    found: list[list[str]] = [[]]
    for word in lexer:
        if set(word) <= set(';|&()\n'):
            found.append([])
        elif found[-1] or '=' not in word:
            found[-1].append(word)
    return [command for command in found if command]


def problem(command: list[str]) -> str:
    """Return the problem of a command, or an empty text."""
    name, *rest = command
    if '/' in name:
        return '' if (ROOT / name).exists() or re.search(r'^/|/bin/', name) else name
    if name == 'make':
        targets = re.findall(r'^([a-z-]+):', (ROOT / 'Makefile').read_text(), flags=re.MULTILINE)
        wanted = [word for word in rest if re.fullmatch('[a-z-]+', word)]
        return next((word for word in wanted if word not in targets), '')
    if name == 'ros2' and rest[:2] in (['run', 'aerarm_ros'], ['launch', 'aerarm_ros']):
        if rest[0] == 'run':
            return problem(rest[2:]) if rest[2] in command_modules() else rest[2]
        return '' if (ROOT / 'launch' / rest[2]).exists() else rest[2]
    if name == 'arm' and not {'-h', '--help'} & {*rest}:
        try:
            make_parser().parse_args(
                rest[: rest.index('--ros-args')] if '--ros-args' in rest else rest
            )
        except SystemExit:
            return ' '.join(command)
        return ''
    scripts = [word for word in rest if word.endswith('.py') and '/' in word] * ('python' in name)
    missing = [word for word in scripts if not (ROOT / word).exists()]
    if missing:
        return missing[0]
    return '' if name in HOST | set(command_modules()) else name


def test_a_command_that_is_not_there_is_found() -> None:
    wrong = 'identifyer --bag x', 'make demos', 'ros2 run aerarm_ros idetifier', 'arm unhome'
    for line in wrong:
        (command,) = commands(line)
        assert problem(command), line
    assert commands('A=1 view &  # in the background') == [['view']]


def test_shell_blocks_name_commands_that_exist() -> None:
    for page in PAGES:
        found = [c for block in blocks(page, 'sh', 'bash') for c in commands(block)]
        assert [' '.join(command) for command in found if problem(command)] == [], page


def test_python_blocks_compile() -> None:
    for page in PAGES:
        for block in blocks(page, 'python'):
            compile(block, str(page), 'exec')


class Page(HTMLParser):
    """Targets of links and pictures, and anchors, of a built page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.anchors = {''}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.anchors.add(given.get('id') or '')
        target = given.get('href' if tag == 'a' else 'src' if tag == 'img' else '')
        if target and not re.match(r'[a-z]+:', target):
            self.targets.append(target)


@pytest.fixture(scope='module')
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for module in ('sphinx', 'myst_parser', 'furo', 'numpydoc', 'sphinx_copybutton'):
        if find_spec(module) is None:
            pytest.skip(f"{module} is not installed: pip install 'aerarm_ros[docs]'")
    out = tmp_path_factory.mktemp('site')
    command = [sys.executable, '-m', 'sphinx', '-q', '-W', '--keep-going', 'docs', str(out)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return out


def test_links_of_the_site_lead_somewhere(site: Path) -> None:
    pages = {path: Page(path.read_text()) for path in site.rglob('*.html')}
    wrong = []
    for path, page in pages.items():
        for target in page.targets:
            name, _, anchor = target.partition('#')
            found = (path.parent / name).resolve() if name else path
            if not found.exists() or found in pages and anchor not in pages[found].anchors:
                wrong.append(f'{path.relative_to(site)}: {target}')
    assert wrong == []
    assert sum(len(page.targets) for page in pages.values()) > 1000


def test_the_site_has_every_page_and_the_public_functions(site: Path) -> None:
    for page in (ROOT / 'docs').rglob('*.md'):
        name = page.relative_to(ROOT / 'docs').with_suffix('.html')
        assert name.stem == 'README' or (site / name).exists(), name
    text = (site / 'reference' / 'api.html').read_text()
    import aerarm_ros

    missing = [name for name in aerarm_ros.__all__ if f'id="aerarm_ros.{name}"' not in text]
    assert missing == []
