"""Find words of the vocabulary's "not" column, and long sentences, in what people read.

The text is that of Markdown pages, of docstrings' first paragraphs, and of all other strings of
three words or more: help texts, parameter descriptions, errors, log lines and page labels.

`python test/docs/prose.py [FILE ...]` prints the findings; `--record` writes their number per file
into prose_exceptions.txt. A file may have neither more findings than listed there nor fewer, so
that the list only shrinks.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
EXCEPTIONS = Path(__file__).with_name('prose_exceptions.txt')
SENTENCE_MAX = 25  # words

# What to write instead, by what not to write.
VOCABULARY = {
    r'(?:is|are|be|been|was|were|not|who|arm) told|told (?:again|of|late)|tells? of|said again': (
        'receives, reports, publishes, re-sent'
    ),
    r'hears?|heard|listened to': 'receives',
    r'believed?|believes': 'estimated',
    r'let in|lets in': 'accepted',
    r'(?<!Clean )leans?|leaned|leaning': 'tilt',
    r'hand-overs?|handed over': 'payload compensation',
    r'tares?|tared': 'bias estimate',
    r'creeps?|creeping': 'saturating viscous friction',
    r'load shares?': 'load-dependent friction',
    r'tak(?:e|es|en|ing) over': 'activate, reset',
    r'way out|ways out': 'recovery hint',
    r'rivals?|sole publisher': 'duplicate publisher',
    r'nil': 'insignificant parameters',
    r'rest postures?': 'home configuration',
    r'anew': 'again',
    r'besides?': 'next to, as well as',
    r'(?:one|value|angle|figure|time)s? a (?:joint|motor|board|node|second|rotor|cycle)': 'per',
    r'a (?:joint|motor|board|rotor) each': 'one per joint',
    r'what (?:else )?comes of it|what came of it': 'the result',
    r'it seems': 'looks like',
    r'that there (?:is|are) not|there is no such': 'unknown',
    r'(?:asked|asks) for one thing': 'sends a request',
    r'nobody|somebody|whoever': 'name the node or the user',
}
WORDS = {re.compile(rf'\b(?:{word})\b', re.IGNORECASE): use for word, use in VOCABULARY.items()}
ANY = re.compile(rf'\b(?:{"|".join(VOCABULARY)})\b', re.IGNORECASE)
CODE = re.compile(r'`+[^`]*`+')
LINK = re.compile(r'!?\[([^\]]*)\]\([^)]*\)')
FENCE = re.compile(r'^( *)(```|~~~).*?^\1?\2', re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r'\n\s*\n|\n\s*(?=[-*|>] ?|#+ |\d+\. )|\|')
# In a message a colon or semicolon ends a statement.
END = re.compile(r'(?<=[.!?])\s+|(?<=[:;])\s+')
WORD = re.compile(r"[^\W\d_][\w'-]*")


def markdown(text: str) -> Iterator[str]:
    """Yield the blocks of a page without code."""
    yield from BLOCK.split(LINK.sub(r'\1', FENCE.sub('', text)))


def literal(node: ast.AST) -> str:
    """Return the text of a string node; a placeholder of an f-string counts as one word."""
    if isinstance(node, ast.JoinedStr):
        return ''.join(literal(part) or '`x`' for part in node.values)
    return str(getattr(node, 'value', '')) if isinstance(node, ast.Constant) else ''


def strings(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the string nodes below a node; an f-string is one of them."""
    if isinstance(node, (ast.Constant, ast.JoinedStr)):
        yield node
        return
    for child in ast.iter_child_nodes(node):
        yield from strings(child)


def python(text: str) -> Iterator[str]:
    """Yield docstrings' first paragraphs and all other strings of three words or more."""
    for node in strings(ast.parse(text)):
        block = literal(node).split('\n\n')[0]
        if len(block.split()) >= 3:
            yield block


def template(text: str) -> Iterator[str]:
    """Yield the lines of a page template or script, without tags and jinja."""
    text = re.sub(r'{[{%#].*?[}%#]}', '`x`', text, flags=re.DOTALL)
    text = re.sub(r'/\*.*?\*/', '', text, flags=re.DOTALL)
    yield from re.sub(r'<[^>]*>', '\n', text).split('\n')


READERS = {'.md': markdown, '.py': python, '.html': template, '.js': template}


def findings(path: Path) -> list[str]:
    """Return the findings in a file, each with what to write instead."""
    found = []
    for block in READERS[path.suffix](path.read_text()):
        text = CODE.sub('`', ' '.join(block.split()))
        for word, use in WORDS.items() if ANY.search(text) else ():
            found += [f"'{hit[0]}' ({use}): {text}" for hit in word.finditer(text)]
        if path.suffix == '.js':
            continue  # its lines are statements
        for sentence in END.split(text):
            count = len(WORD.findall(sentence)) + sentence.count('`')
            if count > SENTENCE_MAX:
                found.append(f'{count} words (at most {SENTENCE_MAX}): {sentence}')
    return found


def files() -> list[Path]:
    """Return the files that people read, CHANGELOG and decisions excepted: they are history."""
    history = {ROOT / 'docs' / 'decisions.md'}
    paths = {ROOT / 'README.md', ROOT / 'CONTRIBUTING.md', ROOT / 'SECURITY.md'}
    paths.update((ROOT / 'docs').rglob('*.md'), (ROOT / 'launch').glob('*.py'))
    for package in ('aerarm_ros', 'aerarm_msgs_py'):
        paths.update(p for p in (ROOT / package).rglob('*') if p.suffix in ('.py', '.html', '.js'))
    return sorted(path for path in paths - history if path.exists())


def counts() -> dict[str, int]:
    """Return the number of findings of each file that has any."""
    found = {str(path.relative_to(ROOT)): len(findings(path)) for path in files()}
    return {name: count for name, count in found.items() if count}


def exceptions() -> dict[str, int]:
    """Return the listed numbers per file."""
    rows = [line.rsplit(maxsplit=1) for line in EXCEPTIONS.read_text().splitlines()]
    return {name: int(count) for name, count in rows}


def main() -> None:
    """Print the findings, or record the number of findings."""
    if sys.argv[1:] == ['--record']:
        EXCEPTIONS.write_text(''.join(f'{name} {count}\n' for name, count in counts().items()))
        return
    for path in [Path(name).resolve() for name in sys.argv[1:]] or files():
        for found in findings(path):
            print(f'{path.relative_to(ROOT)}: {found}')


if __name__ == '__main__':
    main()
