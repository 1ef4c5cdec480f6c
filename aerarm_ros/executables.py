"""Entry points of the installed commands; each calls `main` of a module in `aerarm_ros.nodes`.

Importing the libraries of a node takes some tenths of a second. Ctrl-C must end the program without
a traceback in this time too, so this module imports only fast modules. Without an installation,
`python -m aerarm_ros.executables NAME` runs a command.
"""

from __future__ import annotations

import atexit
import importlib
import itertools
import os
import re
import signal
import sys
from abc import ABCMeta
from collections.abc import Callable, Sequence
from functools import partial
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

from aerarm_ros.ros.process.process_end import (
    INTERRUPTED,
    USER_ERROR,
    StopSignals,
    die_with_launch,
    exit_within,
    print_error,
)

# These commands perform a task, which a stop signal interrupts. All other commands run until a
# stop signal, which ends them with exit status 0.
_TASKS = frozenset(
    (
        'arm',
        'calibrator',
        'demo',
        'excitation',
        'excitation_designer',
        'experiment',
        'identifier',
        'motor_bench',
    )
)

# Options with which a command reads files instead of running a node, and the module of this
# program, which needs neither ROS nor the libraries of the node.
_OFFLINE = {
    'contact_estimator': (('--bag', '--free'), 'aerarm_ros.ros.programs.contact_replay'),
    'payload_estimator': (('--bag',), 'aerarm_ros.ros.programs.payload_replay'),
}
_HELP = ('-h', '--help')
_COMPLETING = '_ARGCOMPLETE'  # environment variable that a shell sets to request completions
# Names of modules of ROS 2. Commands that only read files run without these modules.
_ROS = re.compile(r'rclpy|rpyutils|ament_|ros|rcl_|[a-z]+_(msgs|srvs|interfaces)$')
# Other libraries that take long to import, or that only some installations have.
_HEAVY = ('clarabel', 'coal', 'hppfcl', 'mujoco', 'msgspec', 'pinocchio', 'scipy', 'viser')

_NODES = Path(__file__).parent / 'nodes'


def command_modules() -> dict[str, str]:
    """Return a mapping from the name of each command to its module."""
    paths = sorted(_NODES.rglob('[a-z]*.py'), key=lambda path: path.stem)
    root = Path(__file__).parents[1]
    return {p.stem: '.'.join(p.relative_to(root).with_suffix('').parts) for p in paths}


def controllers() -> tuple[str, ...]:
    """Return the names of all controllers, from the file names in `nodes/controllers`."""
    return tuple(sorted(path.stem for path in (_NODES / 'controllers').glob('[a-z]*.py')))


def __getattr__(name: str) -> Callable[[], int]:
    """Return the function that runs the command `name`, so that entry points can import it."""
    if name.startswith('_'):
        raise AttributeError(name)
    return partial(_run, name)


def _run(name: str) -> int:
    has_task = name in _TASKS
    run = _do if has_task else _serve
    status = 1  # after a traceback
    try:
        die_with_launch()
        if _COMPLETING in os.environ or _requests_help(sys.argv):
            sys.meta_path.insert(0, _StandIns())
        status = run(name)
    except KeyboardInterrupt:
        # A stop signal arrived before the node had installed its handlers.
        status = INTERRUPTED if has_task else 0
    except ModuleNotFoundError as error:
        if not _ROS.match(error.name or ''):
            raise
        status = USER_ERROR
        print_error(
            name,
            f'ROS 2 Jazzy is not found ({error.name} is missing): source '
            "/opt/ros/jazzy/setup.bash, or install its wheels with pip install '.[ros]'"
            + (f'; {clause}' if (clause := _without_ros(name)) else ''),
        )
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):  # exit status of argparse
            status = end.code or 0
        raise
    finally:
        StopSignals.ignore()
        # Before this function, Python waits for threads that may still be working.
        atexit.register(exit_within, status)
    return status


def _requests_help(command_line: Sequence[str]) -> bool:
    """Return whether a command certainly ends with its help: no option may use `-h` as value."""
    own = itertools.takewhile(lambda argument: argument != '--ros-args', command_line)
    return any(
        this in _HELP and not before.startswith('-') for before, this in itertools.pairwise(own)
    )


def program(name: str, arguments: Sequence[str]) -> str:
    """Return the name of the module whose `main` executes a command with these arguments."""
    options, offline = _OFFLINE.get(name, ((), ''))
    is_offline = any(argument.split('=')[0] in options for argument in arguments)
    return offline if is_offline else command_modules()[name]


def _without_ros(name: str) -> str:
    """Return a clause for an error message: the options of a command that work without ROS."""
    options, _ = _OFFLINE.get(name, ((), ''))
    return f'only {" and ".join(options)} work without ROS' if options else ''


def _serve(name: str) -> int:
    early = _Early()
    with StopSignals(early, is_last=True):
        main = importlib.import_module(program(name, sys.argv[1:])).main
        early.is_over = True
        try:
            status: int = main()
        except KeyboardInterrupt:
            return 0
        return status


def _do(name: str) -> int:
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        # Extension modules convert a KeyboardInterrupt into an ImportError, so exit directly.
        # Nothing needs cleaning up yet.
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    main = importlib.import_module(program(name, sys.argv[1:])).main
    signal.signal(signal.SIGINT, before)
    status: int = main()
    return status


class _StandIn(ABCMeta):
    """Class of the stand-ins for classes, functions and constants of a library."""

    def __getattr__(cls, name: str) -> _StandIn:
        if name.startswith('__'):
            raise AttributeError(name)
        return _stand_in(name)


def _stand_in(name: str) -> _StandIn:
    ignore = lambda *_, **__: None  # noqa: E731
    names = ('__init__', '__init_subclass__', '__getattr__')
    return _StandIn(name, (), dict.fromkeys(names, ignore))


class _StandIns(MetaPathFinder, Loader):
    """Importer of empty modules, whose attributes are stand-ins, in place of slow libraries.

    Help and completions only need the tables of parameters and options. Importing ROS and the
    libraries for physics and algebra takes most of the start-up time.
    """

    def find_spec(self, name: str, *_: object) -> ModuleSpec | None:
        """Return a specification of an empty package, if a module belongs to a slow library."""
        library = name.split('.')[0]
        is_slow = library in _HEAVY or _ROS.match(library)
        return ModuleSpec(name, self, is_package=True) if is_slow else None

    def exec_module(self, module: ModuleType) -> None:
        """Give a module the function that creates its attributes."""
        module.__dict__['__getattr__'] = partial(getattr, _stand_in(module.__name__))


class _Early:
    """Handler of stop signals before `main` starts: exits at once, as nothing needs cleaning up."""

    def __init__(self) -> None:
        self.is_over = False

    def __call__(self) -> None:
        # Exit directly, because extension modules convert an exception into an ImportError.
        if not self.is_over:
            os._exit(0)


def _run_named() -> int:
    """Run the command that the first command-line argument names."""
    names = command_modules()
    name = sys.argv[1] if sys.argv[1:] else ''
    if name not in names:
        wrong = f"'{name}' is not a command" if name else 'the command is missing'
        print_error('executables', f'{wrong}: choose one of {", ".join(names)}')
        return USER_ERROR
    sys.argv[:2] = [name]
    return _run(name)


if __name__ == '__main__':
    sys.exit(_run_named())
