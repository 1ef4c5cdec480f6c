"""Storage of encoder zeros across restarts of the bridge, with checks of their validity."""

from __future__ import annotations

import hashlib
import json
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from math import inf, isfinite, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.resources import write_whole
from aerarm_ros.hardware.boards.board_link import BoardLink
from aerarm_ros.hardware.boards.homing import EncoderZeros
from aerarm_ros.hardware.frames.board_messages import TIMESTAMP_PERIOD
from aerarm_ros.hardware.heat_watch import KeptHeat
from aerarm_ros.motion.signals import Array

if TYPE_CHECKING:  # imported only for annotations, because of an import cycle
    from aerarm_ros.hardware.bridge_cycle import BridgeCycle

# Longest time without an answer [s] after which a board's clock, which wraps every 65.5 s, still
# proves that the board stayed on.
AWAY_MAX = 60.0  # see decision 74, also for the following values
# Largest difference of board clock and host clock [s] (a tick, a frame's age, a host delay), ...
_TICKS = 0.01
_DRIFT = 5e-4  # ... plus this fraction of the elapsed time; quartz crystals are five times better.
# Largest speed of a falling joint with its motor off, relative to its speed limit, ...
_FALL_FACTOR = 2.5
_TURNED = 0.02  # [rad] ... plus this tolerance
# A joint's mechanical stops lie at most this far beyond its limits [rad].
_STOPS = 0.35
# Near an index pulse the count does not show on which side of the pulse it is [rad, motor].
_PULSE = 0.05
_SAME_PULSE = 1e-6  # [rad]
_TURN = 2.0 * pi
_SUSPENDED = 0.05  # [s] largest time between reading the two clocks of the host
LONGEST = 65536  # largest number of characters of a file that is read


class KeptZerosError(ValueError):
    """Error: stored encoder zeros cannot be used; the message gives the reason."""


@dataclass(frozen=True)
class KeptJoint:
    """Stored encoder zero and encoder state of a joint.

    Attributes
    ----------
    zero, position
        Reported motor angle at motor angle zero, and last reported motor angle [rad].
    pulse_offset
        Motor angle of the index pulse used to find the zero, see `Homing`.
    """

    name: str
    zero: float
    position: float
    pulse_offset: float
    index_detected: bool
    index_toggle: bool


@dataclass(frozen=True)
class KeptBoard:
    """Stored host time [s, monotonic], board time [s] and error code of a board's last answer."""

    name: str
    time: float
    timestamp: float
    error: int
    joints: tuple[KeptJoint, ...]


@dataclass(frozen=True)
class HostClock:
    """Identity of the host's monotonic clock: last start and total sleep of the host.

    Attributes
    ----------
    boot
        Identity of the host's last start, at which its monotonic clock was reset.
    suspended
        Time that the host has slept since its start [s]; its clock stood still, the boards' did
        not.
    """

    boot: str
    suspended: float


_Record = TypeVar('_Record', KeptJoint, KeptBoard, HostClock)


@dataclass(frozen=True)
class KeptZeros:
    """Stored state of a bridge: arm, host clock, encoder zeros per board, motor temperatures."""

    arm: str
    host: HostClock
    boards: tuple[KeptBoard, ...]
    heat: KeptHeat | None = None

    def text(self) -> str:
        """Return the stored state as text with a digest, as the state file contains it."""
        return sealed(json.dumps(self, default=_entry))

    @staticmethod
    def parse(text: str) -> KeptZeros:
        """Parse a state file's text; raise KeptZerosError if it is incomplete or was changed."""
        try:
            if len(text) > LONGEST:
                raise ValueError
            envelope = json.loads(text)
            if sealed(envelope['kept']) != text:
                raise ValueError
            document = json.loads(envelope['kept'])
            boards = []
            for board in document['boards']:
                joints = tuple(_record(KeptJoint, joint) for joint in board['joints'])
                boards.append(_record(KeptBoard, {**board, 'joints': joints}))
            host = _record(HostClock, document['host'])
            heat = _heat(document.get('heat'))
            return KeptZeros(str(document['arm']), host, tuple(boards), heat)
        except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
            raise KeptZerosError(
                'the file is incomplete or was written by another program'
            ) from None

    def check(self, arm: str, host: HostClock, now: float) -> KeptZeros:
        """Return this state; raise KeptZerosError if it is of another arm or host start.

        Parameters
        ----------
        arm
            `arm_identity` of the arm.
        host
            Host clock that `now` refers to.
        now
            Time [s, monotonic].
        """
        if self.arm != arm:
            raise KeptZerosError(
                'the file belongs to another arm, or to another configuration of its drives'
            )
        if self.host.boot != host.boot:
            raise KeptZerosError('the file was written before the host was started')
        if abs(self.host.suspended - host.suspended) > _SUSPENDED:
            raise KeptZerosError('the file was written before the host was suspended')
        times = [board.time for board in self.boards]
        times += [self.heat.time] if self.heat else []
        if any(time > now for time in times):
            raise KeptZerosError('the file has a time in the future')
        return self


def sealed(kept: str) -> str:
    """Return a text with its digest, by which `KeptZeros.parse` detects a changed text."""
    return json.dumps({'sha256': hashlib.sha256(kept.encode()).hexdigest(), 'kept': kept})


def arm_identity(config: ArmConfig) -> str:
    """Return a digest of all parts of the configuration that determine the encoder zeros."""
    boards = [(board.name, board.device, board.encoders) for board in config.boards]
    joints = [
        (joint.name, joint.board, joint.channel, joint.sign, joint.offset, joint.gear.ratio)
        for joint in config.joints
    ]
    parts = [config.name, config.profile, boards, joints, list(config.rest_position)]
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


class ZeroRecall:
    """Checks, at the first answer of each board, whether its stored encoder zeros are still valid.

    The board's flag `index detected` alone is not sufficient, because it stays set. The times
    elapsed on the board's clock and on the host clock must agree. The board must still report
    detected index pulses, and errors that last until a power cycle. The unpowered joint must have
    been able to move to each reported angle within its mechanical stops. Each index bit must have
    flipped once per pulse between the stored angle and the reported angle.

    Parameters
    ----------
    zeros
        State of the zeros, in which the reasons for rejecting stored zeros are recorded.
    links
        Links to the arm's boards.
    zero
        (n,) reported angles [rad] at motor angle zero; accepted zeros are written into it.
    kept
        Stored state, or the reason why it cannot be used; None without stored state.
    pulse_offset
        (n,) or one for all: motor angles of the index pulses modulo one turn [rad].

    Attributes
    ----------
    pulse_offset
        Motor angles of the index pulses, (n,) [rad]; updated in place.
    """

    def __init__(
        self,
        config: ArmConfig,
        zeros: EncoderZeros,
        links: Sequence[BoardLink],
        zero: Array,
        kept: KeptZeros | str | None = None,
        pulse_offset: ArrayLike = 0.0,
    ) -> None:
        self._config = config
        self._zeros = zeros
        self._links = tuple(links)
        self._zero = zero
        self.pulse_offset: Array = np.zeros(config.n) + np.asarray(pulse_offset, dtype=float)
        self._waiting: dict[str, KeptBoard] = {}
        if isinstance(kept, KeptZeros):
            self._waiting = {board.name: board for board in kept.boards}
        elif kept:
            zeros.explain(range(config.n), kept)

    @property
    def is_on(self) -> bool:
        """Whether a board with stored encoder zeros has not answered yet."""
        return bool(self._waiting)

    def look(self) -> bool:
        """Check the stored encoder zeros of boards that have just connected.

        Returns
        -------
        bool
            Whether the zero of a joint has changed.
        """
        changed = False
        for link in self._links:
            board = self._waiting.get(link.monitor.name)
            if board is None or not link.fresh or not link.monitor.is_connected:
                continue
            del self._waiting[board.name]
            joints = [number for number, _ in link.joints if not self._zeros.absolute[number]]
            problem = self._problem(board, link)
            if problem:
                self._zeros.explain(joints, problem)
                continue
            kept = {joint.name: joint.zero for joint in board.joints}
            again = [number for number in joints if self._zeros.names[number] in kept]
            for number in again:
                self._zero[number] = kept[self._zeros.names[number]]
            self._zeros.found(again)
            changed = True
        return changed

    def take_pulse_offset(self, pulse_offset: ArrayLike, motors_are_off: bool) -> str:
        """Change the motor angles [rad] of the index pulses, n angles or one for all motors.

        The zeros of joints homed with different angles become unknown. Returns why the old angles
        stay, or ''.
        """
        each = np.broadcast_to(np.asarray(pulse_offset, dtype=float), len(self.pulse_offset))
        changed = np.flatnonzero(np.abs(each - self.pulse_offset) > _SAME_PULSE).tolist()
        if not changed:
            return ''
        if not motors_are_off:
            return 'the motors are on: the bridge uses the new index pulses after its next restart'
        self.pulse_offset[:] = each
        joints = (number for number in changed if not self._zeros.absolute[number])
        self._zeros.lose(joints, 'commissioned since it was homed')
        return ''

    def keep(self, arm: str, host: HostClock) -> KeptZeros | None:
        """Return the state to store; None until all stored encoder zeros have been checked."""
        if self._waiting:
            return None
        zero = self._zero.tolist()
        pulses = self.pulse_offset.tolist()
        boards = (_to_keep(link, self._zeros, zero, pulses) for link in self._links)
        return KeptZeros(arm, host, tuple(board for board in boards if board is not None))

    def _problem(self, board: KeptBoard, link: BoardLink) -> str:
        """Return the reason if a board's stored encoder zeros cannot be used, otherwise ''."""
        state, away, name = link.state, link.answered_at - board.time, board.name
        if away < 0.0:
            return f'{name} answered before its zero was stored'
        if away > AWAY_MAX:
            return (
                f'{name} was not observed for {away:.0f} s, but its clock can show a restart only '
                f'within {AWAY_MAX:g} s'
            )
        ahead = state.timestamp - board.timestamp - away
        off = (ahead + 0.5 * TIMESTAMP_PERIOD) % TIMESTAMP_PERIOD - 0.5 * TIMESTAMP_PERIOD
        lost_error = link.keeps_errors and board.error and not state.error
        if abs(off) > _TICKS + _DRIFT * away or lost_error:
            return f'{name} was switched off and on while the bridge was not running'
        kept = {joint.name: joint for joint in board.joints}
        for number, channel in link.joints:
            joint = kept.get(self._config.joint_names[number])
            if joint is None:
                continue
            if joint.index_detected and not state.index_detected[channel]:
                return f'{name} was switched off and on while the bridge was not running'
            if abs(joint.pulse_offset - self.pulse_offset[number]) > _SAME_PULSE:
                return f'{name} was homed with another index pulse of {joint.name}'
            toggled = state.index_toggle[channel] != joint.index_toggle
            if not self._can_have_moved(number, joint, state.position[channel], toggled, away):
                return f'{name} has another encoder count of {joint.name} than before'
        return ''

    def _can_have_moved(
        self, number: int, kept: KeptJoint, position: float, toggled: bool, away: float
    ) -> bool:
        """Return whether a motion of the joint can explain stored and reported angle."""
        joint = self._config.joints[number]
        before, after = kept.position - kept.zero, position - kept.zero
        q = joint.sign * joint.gear.ratio * after + joint.offset
        turned = joint.gear.ratio * abs(after - before)
        if turned > _TURNED + _FALL_FACTOR * joint.velocity_max * away:
            return False
        if not joint.position_min - _STOPS < q < joint.position_max + _STOPS:
            return False
        before, after = before - kept.pulse_offset, after - kept.pulse_offset
        if min(_from_pulse(before), _from_pulse(after)) < _PULSE:
            return True
        return toggled == bool((before // _TURN - after // _TURN) % 2)


def _from_pulse(angle: float) -> float:
    """Return the distance of a motor angle from the nearest index pulse [rad]."""
    return abs((angle + pi) % _TURN - pi)


def _to_keep(
    link: BoardLink, zeros: EncoderZeros, zero: Sequence[float], pulses: Sequence[float]
) -> KeptBoard | None:
    """Return the stored form of a board's known encoder zeros at its last answer."""
    state, known = link.state, zeros.known
    joints = tuple(
        KeptJoint(
            zeros.names[number],
            zero[number],
            state.position[channel],
            pulses[number],
            bool(state.index_detected[channel]),
            bool(state.index_toggle[channel]),
        )
        for number, channel in link.joints
        if known[number] and not zeros.absolute[number]
    )
    if not joints or not isfinite(link.answered_at):
        return None
    return KeptBoard(link.monitor.name, link.answered_at, state.timestamp, state.error, joints)


def _entry(record: Any) -> dict[str, Any]:
    """Return a record as an entry of a file; the compiled `KeptHeat` has no `__dict__`."""
    return {item.name: getattr(record, item.name) for item in fields(record)}


def _record(kind: type[_Record], entry: dict[str, Any]) -> _Record:
    """Return a record of a file's entry; raise an error if a key or a number is wrong."""
    for item in fields(kind):
        if item.type == 'float':
            _number(entry[item.name])
    return kind(**entry)


def _heat(entry: dict[str, Any] | None) -> KeptHeat | None:
    if entry is None:  # the file was written by a bridge that stored no temperatures
        return None
    rows = [tuple(map(_number, entry[key])) for key in ('windings', 'housings')]
    return KeptHeat(_number(entry['time']), *rows)


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise ValueError
    return float(value)


_PERIOD = 1.0  # [s]
_BOOT_ID = Path('/proc/sys/kernel/random/boot_id')


def host_clock() -> HostClock:
    """Return the identity of the host's monotonic clock; raise OSError if it is unavailable."""
    boot = _BOOT_ID.read_text(encoding='ascii').strip()
    suspended = time.clock_gettime(time.CLOCK_BOOTTIME) - time.monotonic()
    return HostClock(boot, suspended)


def _text(path: Path) -> str:
    """Return the text of a regular file; raise an error for a pipe or device without opening it."""
    if path.exists() and not path.is_file():
        raise KeptZerosError('the path is not a regular file')
    with path.open(encoding='utf-8') as file:
        return file.read(LONGEST + 1)


class ZeroFile:
    """Writes the known encoder zeros to a file once per second, and at once after a change.

    The thread of the bridge cycle formats the text in its idle time, and another thread writes
    it, so the disk cannot delay a cycle. The file is not synchronized to disk, because a restart
    of the host invalidates it.

    Parameters
    ----------
    path
        Path of the file; its folder is created. None stores nothing.

    Attributes
    ----------
    problem
        Reason why the file cannot be written, or ''.
    """

    def __init__(self, path: Path | None, config: ArmConfig) -> None:
        self.problem = ''
        self._path = path
        self._config = config
        self._arm = arm_identity(config)
        self._host: HostClock | None = None
        self._due = -inf
        self._changes = -1
        self._text = ''
        self._news = threading.Event()
        self._ends = False
        self._thread: threading.Thread | None = None

    def read(self, now: float) -> KeptZeros | str | None:
        """Return the stored state, a text on why it is unusable, or None if no file exists.

        Parameters
        ----------
        now
            Time [s, monotonic].
        """
        if self._path is None:
            return None
        try:
            self._host = host_clock()
            return KeptZeros.parse(_text(self._path)).check(self._arm, self._host, now)
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError, KeptZerosError) as error:
            reason = getattr(error, 'strerror', None) or error
            if isinstance(error, UnicodeDecodeError):
                reason = 'the file is not a text file'
            return f'the state file {self._path} cannot be used, because {reason}'

    def update(self, cycle: BridgeCycle, now: float) -> None:
        """Write the bridge's encoder zeros if they have changed or a second has passed."""
        if self._host is None or (now < self._due and cycle.zeros.changes == self._changes):
            return
        kept = cycle.recall.keep(self._arm, self._host)
        if kept is None:
            return
        self._due, self._changes = now + _PERIOD, cycle.zeros.changes
        self._text = replace(kept, heat=cycle.heat.keep(now)).text()
        self._news.set()
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name='zero_file', daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Write pending data and end the writing thread; the next update restarts the thread."""
        if self._thread is not None:
            self._ends = True
            self._news.set()
            self._thread.join()
            self._thread, self._ends = None, False

    def _run(self) -> None:
        while not self._ends or self._news.is_set():
            self._news.wait()
            self._news.clear()
            if self._path is not None and self._text:
                self._write(self._path, self._text)

    def _write(self, path: Path, text: str) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, text, durable=False)
            self.problem = ''
        except OSError as error:
            self.problem = (
                f'the state file {path} cannot be written ({error.strerror}): the arm must be '
                'homed after a restart of the bridge'
            )
