"""The installed commands: each runs the `main` of its module in `aerarm_ros.nodes`.

What a node needs takes some tenths of a second to import, and a Ctrl-C meanwhile is an ordinary
end too. So the commands come through here, where nothing is imported beforehand. `python -m
aerarm_ros.executables NAME` is the same without an installed command.
"""

import atexit
import importlib
import os
import re
import signal
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import ModuleType

from aerarm_ros.ros.process.die_with_parent import die_with_launch
from aerarm_ros.ros.process.process_end import (
    INTERRUPTED,
    USER_ERROR,
    StopSignals,
    exit_within,
    print_error,
)

# They have something to finish, and are ended before that by a signal. All others serve until
# they are asked to end, so that a signal is how they end well, at any time.
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

_HELP = ('-h', '--help')
_COMPLETING = '_ARGCOMPLETE'  # of a shell that asks for completions
# What most nodes import, and no help needs: together they take longer than all else.
_HEAVY = ('mujoco', 'pinocchio')
# What ROS 2 brings; `calibrator`, `identifier`, `excitation_designer` and `experiment` run
# without it.
_ROS = re.compile(r'rclpy|rpyutils|ament_|ros|rcl_|[a-z]+_(msgs|srvs|interfaces)$')


_NODES = Path(__file__).parent / 'nodes'


def command_modules() -> dict[str, str]:
    """Return the module of each command: the files of `nodes` and its folder `controllers`."""
    paths = sorted(_NODES.rglob('[a-z]*.py'), key=lambda path: path.stem)
    root = Path(__file__).parents[1]
    return {p.stem: '.'.join(p.relative_to(root).with_suffix('').parts) for p in paths}


def controllers() -> tuple[str, ...]:
    """Return the names of the controllers: each file in `nodes/controllers` is one."""
    return tuple(sorted(path.stem for path in (_NODES / 'controllers').glob('[a-z]*.py')))


def __getattr__(name: str) -> Callable[[], int]:
    """Return the command of a module in `aerarm_ros.nodes`, for `from ... import NAME`."""
    if name.startswith('_'):
        raise AttributeError(name)
    return partial(_run, name)


def _run(name: str) -> int:
    has_task = name in _TASKS
    run = _do if has_task else _serve
    status = 1  # of a traceback
    try:
        die_with_launch()
        if _COMPLETING in os.environ or any(argument in _HELP for argument in sys.argv[1:]):
            sys.modules.update((name, _Unloaded(name)) for name in _HEAVY)
        status = run(name)
    except KeyboardInterrupt:
        # Of who serves, one that comes before its own handlers are there.
        status = INTERRUPTED if has_task else 0
    except ModuleNotFoundError as error:
        if not _ROS.match(error.name or ''):
            raise
        status = USER_ERROR
        print_error(
            name,
            f'needs ROS 2 Jazzy ({error.name} is missing): source /opt/ros/jazzy/setup.bash, or '
            "install its wheels with pip install '.[ros]'",
        )
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):  # argparse's
            status = end.code or 0
        raise
    finally:
        StopSignals.ignore()
        # From when Python has waited for its threads, in which something may be left to do.
        atexit.register(exit_within, status)
    return status


def _serve(name: str) -> int:
    early = _Early()
    with StopSignals(early, is_last=True):
        main = importlib.import_module(command_modules()[name]).main
        early.is_over = True
        try:
            status: int = main()
        except KeyboardInterrupt:
            return 0
        return status


def _do(name: str) -> int:
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        # Extension modules make an ImportError of a KeyboardInterrupt, and there is nothing to
        # leave in order yet.
        signal.signal(signal.SIGINT, lambda *_: os._exit(INTERRUPTED))
    main = importlib.import_module(command_modules()[name]).main
    signal.signal(signal.SIGINT, before)
    status: int = main()
    return status


class _Unloaded(ModuleType):
    """Stands for a module until something of it is used, if ever."""

    def __getattr__(self, attribute: str) -> object:
        if attribute.startswith('__'):
            raise AttributeError(attribute)
        if sys.modules.get(self.__name__) is self:
            del sys.modules[self.__name__]
        return getattr(importlib.import_module(self.__name__), attribute)


class _Early:
    """What a stop signal does before `main` has begun: there is nothing to leave in order yet."""

    def __init__(self) -> None:
        self.is_over = False

    def __call__(self) -> None:
        # An exception would not do: extension modules make an ImportError of it.
        if not self.is_over:
            os._exit(0)


def _run_named() -> int:
    """Run the command that the first argument names."""
    names = command_modules()
    name = sys.argv[1] if sys.argv[1:] else ''
    if name not in names:
        wrong = f"'{name}' is no command" if name else 'the name of a command comes first'
        print_error('executables', f'{wrong}: give one of {", ".join(names)}')
        return USER_ERROR
    sys.argv[:2] = [name]
    return _run(name)


if __name__ == '__main__':
    sys.exit(_run_named())
