"""Start and stop an executable of this package as a child process, and set up its environment."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping, MutableMapping, Sequence
from itertools import chain
from pathlib import Path
from pwd import getpwuid
from typing import IO

from aerarm_ros.description.resources import resource
from aerarm_ros.ros.process.process_end import LAUNCH_PID

# [s] Much longer than the shut-down of any node (last chunk of a bag, last frames to the boards). A
# shut-down takes 0.3 s on an idle host and more than 10 s next to 20 busy programs. Only a hanging
# node may be killed, because a killed recorder loses the end of its bag.
STOP_TIMEOUT = 60.0
_TAIL = 65536  # [bytes]; a page reads the log many times per second, and logs grow for days

# The first of these variables that is set selects ROS's log directory. Without any of them ROS
# does not start.
_LOG_CHOICES = ('ROS_LOG_DIR', 'ROS_HOME', 'HOME')


def find_log_directory(environment: MutableMapping[str, str] = os.environ) -> None:
    """Select a log directory for ROS if no environment variable selects one.

    Schedulers and service managers start programs without HOME. The log directory is then in the
    user's home directory, or temporary. To be called before `rclpy.init`.

    Parameters
    ----------
    environment
        Environment of this process, or of a process to be started.
    """
    if any(environment.get(name) for name in _LOG_CHOICES):
        return
    home = _home_of_this_user()
    if home is not None:
        environment['HOME'] = home
    else:
        environment['ROS_LOG_DIR'] = tempfile.mkdtemp(prefix='aerarm_ros_log_')


def _home_of_this_user() -> str | None:
    """Return this user's home directory from the system's user database, None if not writable."""
    try:
        home = getpwuid(os.getuid()).pw_dir
    except KeyError:
        return None
    return home if os.access(home, os.W_OK) else None


class NodeProcess:
    """Child process that runs an executable of this package.

    The child process ends when the thread that started it ends, even if this process is killed.
    Ctrl-C does not reach the child process, so that this process can end its children in the right
    order.

    Parameters
    ----------
    name
        Name of the executable, for example ``recorder``.
    arguments
        Command-line arguments before ``--ros-args``.
    parameters
        ROS parameters given with ``-p name:=value``.
    environment
        Environment variables added to those of this process, for example ``ROS_DOMAIN_ID``.
    log
        File for standard output and error; the child inherits both streams if None.
    """

    program: tuple[str, ...] = ('-m', 'aerarm_ros.executables')

    def __init__(
        self,
        name: str,
        arguments: Sequence[str] = (),
        parameters: Mapping[str, object] | None = None,
        environment: Mapping[str, str] | None = None,
        log: Path | None = None,
    ) -> None:
        self.name = name
        command = [sys.executable, *self.program, name, *arguments]
        command += parameter_arguments(parameters or {})
        self.log = log
        self._stream: IO[bytes] | None = log.open('wb') if log else None
        self._process = subprocess.Popen(
            command,
            env=ros_environment(environment) | {LAUNCH_PID: str(os.getpid())},
            stdin=subprocess.DEVNULL,
            stdout=self._stream,
            stderr=subprocess.STDOUT if self._stream else None,
            process_group=0,
        )

    @property
    def returncode(self) -> int | None:
        """Exit status of the child process, None while it is running."""
        return self._process.poll()

    @property
    def pid(self) -> int:
        """Process id of the child process."""
        return self._process.pid

    def wait(self, timeout: float | None = None) -> int:
        """Wait until the child process has ended, at most `timeout` [s]; return its exit status.

        Raises
        ------
        subprocess.TimeoutExpired
            If the child process still runs after `timeout`.
        """
        return self._process.wait(timeout)

    def ask_to_end(self) -> None:
        """Send SIGTERM to the child process, without waiting for its end."""
        self._process.send_signal(signal.SIGTERM)

    def stop(self, sent: signal.Signals = signal.SIGTERM, timeout: float = STOP_TIMEOUT) -> int:
        """End the child process by a signal, or kill it after a time-out; return its exit status.

        The default signal is not SIGINT, because SIGINT causes a traceback in a process that is
        still importing modules.
        """
        if self._process.poll() is None:
            self._process.send_signal(sent)
            try:
                self._process.wait(timeout)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        if self._stream:
            self._stream.close()
        return self._process.returncode

    def tail(self, lines: int = 15) -> str:
        """Return the last `lines` lines of the log file, at most 64 KiB."""
        if not self.log:
            return ''
        with self.log.open('rb') as stream:
            stream.seek(max(0, stream.seek(0, os.SEEK_END) - _TAIL))
            text = stream.read().decode(errors='replace')
        return '\n'.join(text.splitlines()[-lines:])

    def __enter__(self) -> NodeProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def ros_environment(extra: Mapping[str, str] | None = None) -> dict[str, str]:
    """Return this process's environment with the variables `extra`, for a child process."""
    environment = {**os.environ, **(extra or {})}
    use_packaged_profile(environment)
    find_log_directory(environment)
    return environment


def parameter_arguments(parameters: Mapping[str, object]) -> list[str]:
    """Return the command-line arguments that set the given ROS parameters of a node."""
    rules = [('-p', f'{key}:={_as_yaml(value)}') for key, value in parameters.items()]
    return ['--ros-args', *chain(*rules), '--'] if rules else []


def _as_yaml(value: object) -> str:
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, (list, tuple)):
        return '[' + ', '.join(_as_yaml(item) for item in value) + ']'
    return str(value) or "''"


_RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
_PEERS = ('ROS_STATIC_PEERS', 'ROS_DISCOVERY_SERVER')
NETWORK = 'AERARM_NETWORK'
"""Environment variable whose value `open` lets other hosts discover the nodes."""
_OPEN = 'open'


def stay_on_this_host(environment: MutableMapping[str, str] = os.environ) -> str:
    """Restrict ROS discovery to this host, unless AERARM_NETWORK is `open`.

    A socket that sends to a radio blocks the bridge's cycle once the radio's queue is full. The
    1 kHz topics therefore use only shared memory and the loopback interface. The node `ground_link`
    connects to other hosts. To be called before `rclpy.init`.

    Returns
    -------
    notice
        Names of ignored environment variables, and advice; empty if no variable is ignored.

    Raises
    ------
    ValueError
        If AERARM_NETWORK has an invalid value.
    """
    network = environment.get(NETWORK, '')
    if network not in ('', _OPEN):
        raise ValueError(
            f"environment variable {NETWORK}='{network}' is invalid: unset it, or set "
            f'{NETWORK}={_OPEN}'
        )
    if network:
        return ''
    ignored = [name for name in _PEERS if environment.pop(name, '')]
    if environment.get(_RANGE, '').upper() not in ('', 'LOCALHOST', 'OFF'):
        ignored.append(f'{_RANGE}={environment[_RANGE]}')
    # This variable has precedence over the discovery range in ROS 2 Jazzy.
    if environment.pop('ROS_LOCALHOST_ONLY', '') == '0':
        ignored.append('ROS_LOCALHOST_ONLY=0')
    if environment.get(_RANGE, '').upper() != 'OFF':
        environment[_RANGE] = 'LOCALHOST'
    if not ignored:
        return ''
    return (
        f'ignoring {", ".join(ignored)}: nodes communicate on this host only, because a slow '
        "network would block the bridge's cycle. To connect hosts, use ground_link, or set "
        f'{NETWORK}={_OPEN}'
    )


def is_on_this_host(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether environment variables restrict ROS discovery to this host."""
    if environment.get('ROS_STATIC_PEERS') or environment.get('ROS_DISCOVERY_SERVER'):
        return False
    return (
        environment.get(_RANGE, '').upper() == 'LOCALHOST'
        or environment.get('ROS_LOCALHOST_ONLY') == '1'
    )


_PARTICIPANTS = 20  # discovery ports of a domain that are tried


def is_domain_free(domain: int) -> bool:
    """Return whether no node on this host uses the ROS domain `domain` (0 to 101).

    Each of the first participants in a domain binds its own discovery port (RTPS 2.2, 9.6.1.1). The
    first participant may have ended before the others, so the function tries 20 ports.
    """
    for participant in range(_PARTICIPANTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(('', 7400 + 250 * domain + 10 + 2 * participant))
            except OSError:
                return False
    return True


# Read by Fast DDS when a process creates its first participant; other middleware ignores it.
PROFILES_FILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
_EVERYWHERE, _LOOPBACK = 'fastdds.xml', 'fastdds_loopback.xml'


def use_packaged_profile(environment: MutableMapping[str, str] = os.environ) -> None:
    """Select a Fast DDS profile of this package, unless the environment selects another profile.

    With the profile, nodes announce themselves often, so discovery takes a fraction of a second
    instead of up to three seconds. If discovery is restricted to this host, the profile uses only
    the loopback interface. To be called before `rclpy.init`, and after `stay_on_this_host`.

    Parameters
    ----------
    environment
        Environment of this process, or of a process to be started.

    Raises
    ------
    FileNotFoundError
        If the package's files are not installed.
    """
    # A parent process, or the user, may have selected a packaged profile for another discovery
    # range.
    if not environment.get(PROFILES_FILE) or has_packaged_profile(environment):
        name = _LOOPBACK if is_on_this_host(environment) else _EVERYWHERE
        environment[PROFILES_FILE] = str(resource('config', name))


def has_packaged_profile(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether the environment selects one of the Fast DDS profiles of this package."""
    packaged = [_content(resource('config', name)) for name in (_EVERYWHERE, _LOOPBACK)]
    return _content(Path(environment.get(PROFILES_FILE, ''))) in packaged


def _content(path: Path) -> bytes | None:
    """Return the content of a file, which symbolic links and copies share; None without a file."""
    try:
        return path.read_bytes()
    except OSError:
        return None
