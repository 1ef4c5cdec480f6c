"""What every executable does around its node: start, run, end cleanly."""

import sys
from collections.abc import Callable, Sequence
from typing import Protocol

import rclpy
from rclpy._rclpy_pybind11 import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException


class Runnable(Protocol):
    """A node with its own loop.

    Attributes
    ----------
    status
        Exit status once `run` has returned.
    """

    status: int

    def run(self) -> None:
        """Work until the ROS context is shut down."""

    def close(self) -> None:
        """Leave everything safe and destroy the node; called once, whatever happened."""


def run_node(name: str, create: Callable[[], Runnable], args: Sequence[str] | None = None) -> int:
    """Create a node, run it, close it, and return the exit status.

    SIGINT, SIGTERM and a shutdown from outside are ordinary ends (0). What a user can
    repair (an argument, a parameter, a file: ValueError while creating, OSError at any time)
    is one line on standard error (1). Anything else is a defect and keeps its traceback.

    Parameters
    ----------
    name
        Executable, for error messages.
    create
        Makes the node; rclpy is initialised by then.
    args
        Command line with ROS arguments, by default the process's own.
    """
    node = None
    try:
        rclpy.init(args=args)
        try:
            node = create()
        except ValueError as error:
            return _report(name, error)
        node.run()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (OSError, RCLInvalidROSArgsError, UnknownROSArgsError) as error:
        return _report(name, error)
    except (RCLError, InvalidHandle) as error:
        # A signal shuts the context down under whatever call is going on.
        if node is None:
            return _report(name, error)
        if rclpy.ok():
            raise
    finally:
        try:
            if node is not None:
                node.close()
        finally:
            rclpy.try_shutdown()
    return node.status if node is not None else 0


def _report(name: str, error: Exception) -> int:
    text = ' '.join(str(error).split())
    print(f'{name}: {text}', file=sys.stderr)
    return 1
