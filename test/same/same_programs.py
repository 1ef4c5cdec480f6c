"""Programs of the suite as processes, and the figures in the files that they write."""

import json
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.executable).parent
# Files with results, in the order in which a difference is reported.
RESULTS = ('summary.json', '*.yaml')
# Durations and paths differ from run to run.
_OF_THE_RUN = frozenset(('seconds', 'file', 'path', 'date', 'created'))
_STOPPING = 20.0  # [s]


def finish(name: str, *arguments: str, timeout: float = 600.0) -> str:
    """Run an executable to its end; return its output.

    Raises
    ------
    RuntimeError
        If its exit status is not 0.
    """
    done = subprocess.run(
        [str(BIN / name), *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=timeout,
    )
    if done.returncode:
        raise RuntimeError(f'{name}: exit status {done.returncode}:\n{done.stdout[-2000:]}')
    return done.stdout


def parameters(given: Mapping[str, object]) -> list[str]:
    """Return the arguments that set a node's parameters."""
    pairs = [['-p', f'{key}:={json.dumps(value)}'] for key, value in given.items()]
    return ['--ros-args', *(argument for pair in pairs for argument in pair)]


@contextmanager
def executable(
    work: Path, name: str, *arguments: str, **given: object
) -> Iterator[subprocess.Popen[bytes]]:
    """Run an executable as a process."""
    command = [str(BIN / name), *arguments, *parameters(given)]
    with (work / f'{name}.log').open('wb') as log:
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=log, stderr=log, process_group=0
        )
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(_STOPPING)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def figures(name: str, folder: Path) -> dict[str, object]:
    """Return the numbers of the result files in a directory, one item per file.

    Sentences are left out, because texts may be reworded.
    """
    paths = [path for pattern in RESULTS for path in sorted(folder.glob(pattern))]
    if not paths:
        raise RuntimeError(f'{name}: no results in {folder}')
    return {f'figures/{name}/{path.name}': numbers(read(path)) for path in paths}


def read(path: Path) -> object:
    """Return the content of a JSON or YAML file."""
    text = path.read_text()
    return json.loads(text) if path.suffix == '.json' else yaml.safe_load(text)


def numbers(value: object) -> object:
    """Return a JSON value without sentences, and without values that differ from run to run."""
    if isinstance(value, dict):
        kept = {_place(str(key)): item for key, item in value.items() if key not in _OF_THE_RUN}
        return {key: numbers(item) for key, item in kept.items()}
    if isinstance(value, list):
        return [numbers(item) for item in value]
    if isinstance(value, str):
        return '' if ' ' in value or '/' in value else value
    return value


def _place(key: str) -> str:
    """Return a key, or the end of a path without this run's directory."""
    return '/'.join(key.split('/')[-2:])
