"""Acceptance or rejection of received joint commands by publisher, age and content."""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.motion.signals import Array

Mask = NDArray[np.bool_]


class CommandBuffer:
    """Joint command for n joints, in which NaN marks an unused quantity.

    In contrast to the `JointCommand` of a controller, each joint may use other quantities, and
    the arrays are reused: each received command overwrites them. Position or velocity switches the
    gains of the boards' control law (thesis (4.4)) on. The boards integrate a velocity without
    position (4.5). Effort is added to the law; effort alone means torque control.

    Attributes
    ----------
    q, dq, tau
        (n,) positions [rad], velocities [rad/s], efforts [Nm].
    rows
        (3, n) the same values.
    """

    def __init__(self, n: int) -> None:
        self.rows: Array = np.full((3, n), np.nan)
        self.q, self.dq, self.tau = self.rows

    @classmethod
    def standstill(cls, n: int) -> 'CommandBuffer':
        """Return a command of zero velocity for every joint."""
        command = cls(n)
        command.dq[:] = 0.0
        return command


# Identifier of the publisher of a command; None if publishers cannot be distinguished.
Source = bytes | str | None
Values = Sequence[float] | NDArray[np.float64] | None


class OfferedCommand(NamedTuple):
    """Received joint command, with its publisher and its age.

    Attributes
    ----------
    names
        Names of the joints, in any order; all values have the order of these names.
    position, velocity, effort
        One value per name [rad], [rad/s], [Nm], NaN where unused; None or empty if unused for all
        joints. The given quantities determine a joint's mode, see `CommandBuffer`.
    age_of_stamp
        Age of the state to which the command responds [s].
    source
        Publisher. Commands of other publishers are rejected while the last command of this
        publisher is valid. None is a publisher that cannot be distinguished from others.
    allowed
        Whether the publisher may send commands.
    """

    names: Sequence[str]
    position: Values
    velocity: Values
    effort: Values
    age_of_stamp: float
    source: Source
    allowed: bool = True


class CommandPublishers:
    """Identifies the publisher of each command, and decides whether it may send commands.

    The middleware's message info contains the publisher's global identifier (GID); the list of the
    topic's endpoints maps each GID to a node. `look` stores that list at intervals. A publisher
    whose GID is not in the list yet has an unknown node, which is allowed only if any node is
    allowed.

    Parameters
    ----------
    allowed
        Names of the nodes that may send commands, with or without name space; empty if any node
        may.

    Attributes
    ----------
    names
        Sorted full names of the publishing nodes at the last call of `look`.
    """

    def __init__(self, allowed: Collection[str] = ()) -> None:
        self.names: tuple[str, ...] = ()
        self._allowed = frozenset(allowed)
        self._nodes: Mapping[bytes, str] = {}

    def look(self, nodes: Mapping[bytes, str]) -> None:
        """Store the publishers of joint_command: the full node name per identifier (GID)."""
        self._nodes = nodes
        self.names = tuple(sorted(nodes.values()))

    def knows(self, gid: bytes) -> bool:
        """Whether `look` has stored this publisher."""
        return gid in self._nodes

    def may_command(self, gid: bytes) -> bool:
        """Whether the publisher with this GID may send commands."""
        return self.is_allowed(self._nodes.get(gid, ''))

    def is_allowed(self, name: str) -> bool:
        """Whether a node with this full name may send commands."""
        names = {name, name.removeprefix('/'), name.rpartition('/')[2]} - {''}
        return not self._allowed or not self._allowed.isdisjoint(names)

    @property
    def warning(self) -> str:
        """Warning about forbidden or duplicate publishers of joint_command; '' without such."""
        others = [name for name in self.names if not self.is_allowed(name)]
        if others:
            return (
                f'{", ".join(others)} publishes joint_command but is not in allowed_publishers: '
                'stop the node, or add it to the list'
            )
        if len(self.names) < 2:
            return ''
        return (
            f'joint_command has {len(self.names)} publishers ({", ".join(self.names)}), so the '
            'bridge follows the first sender: stop all but one'
        )


# Reasons for rejecting a command, and what to check.
REJECTIONS: dict[str, str] = {
    'unreadable': 'not a JointState message, or too long for this arm: check its publisher, and '
    'the ROS version',
    'not_ready': 'the arm is not ready: enable it (home it if arm_mode is unhomed), or clear its '
    'fault',
    'not_allowed': 'the publisher is not in allowed_publishers: check this parameter of the bridge',
    'source': 'another publisher is commanding the arm: stop one of the two',
    'names': 'the message does not name each joint of the arm once: compare with joint_states, '
    'and the tf_prefix of both nodes',
    'length': 'an array of the message does not have one value per joint name: check its publisher',
    'infinite': 'a value is infinite: check the controller',
    'nan': 'a joint has no reference at all (NaN everywhere): check the controller',
    'unsupported': (
        'the frame profile has no feed-forward current, so the bridge cannot apply an effort: '
        'use a controller without effort'
    ),
    'stale': (
        'the command responds to an old state: check the CPU load of the controller, and the clocks'
    ),
    'future': (
        'the stamp lies in the future: check the clocks; an emulated arm has its own time on /clock'
    ),
}

_CLOCK_TOLERANCE = 0.005  # [s]
_ORDERS_KEPT = 16


class CommandIntake:
    """Checks commands, stores the last valid command, and counts rejected commands by reason.

    Parameters
    ----------
    joint_names
        Names of the n joints, from base to tool; a command may list them in any order.
    settings
        Settings; this class uses `command_timeout` and `stamp_age_max`.
    effort_supported
        False if the boards' frames carry no feed-forward current.

    Attributes
    ----------
    command
        The last accepted command.
    accepted
        Number of accepted commands.
    rejections
        Number of rejected commands by reason; the reasons are keys of `REJECTIONS`.
    last_rejection, last_rejection_time
        Reason and receipt time [s] of the last rejected command; '' and -inf before the first.
    """

    def __init__(
        self, joint_names: Sequence[str], settings: BridgeSettings, *, effort_supported: bool = True
    ) -> None:
        self.command = CommandBuffer(len(joint_names))
        self.accepted = 0
        self.rejections: Counter[str] = Counter()
        self.last_rejection = ''
        self.last_rejection_time = -inf
        self._names = tuple(joint_names)
        self._settings = settings
        self._effort_supported = effort_supported
        self._orders: dict[tuple[str, ...], NDArray[np.intp] | None] = {self._names: None}
        self._candidate = CommandBuffer(len(joint_names))
        self._received = -inf
        self._source: Source = None
        # [s] latest receipt time of commands that still belong to a publisher that has concluded
        self._last = -inf

    def age(self, now: float) -> float:
        """Return the time [s] since the last accepted command arrived; inf without a command."""
        return now - self._received

    def is_fresh(self, now: float) -> bool:
        """Return whether the last accepted command is younger than `command_timeout`."""
        # A negative age means that the clock went back, so the command's age is unknown.
        return 0.0 <= self.age(now) <= self._settings.command_timeout

    def forget(self) -> None:
        """Discard the last command; any publisher may then send the next one."""
        self._received = -inf
        self._source = None

    def conclude(self, now: float) -> None:
        """Record that the publisher of the commands ends them intentionally at `now` [s].

        Once the commands end, the bridge therefore holds the arm and does not damp it. Commands
        that arrive up to `stamp_age_max` later do not revoke this.
        """
        self._last = now + self._settings.stamp_age_max

    @property
    def is_concluded(self) -> bool:
        """Return whether the last publisher ended its commands intentionally."""
        return self._received <= self._last

    def offer(self, offered: OfferedCommand, now: float, *, ready: bool = True) -> bool:
        """Check a command received at `now` [s]; return whether it is valid and accepted."""
        reason = '' if ready else 'not_ready'
        reason = reason or ('' if offered.allowed else 'not_allowed')
        reason = reason or self._origin_fault(offered.age_of_stamp, now, offered.source)
        reason = reason or self._content_fault(offered)
        if reason:
            self.reject(reason, now)
            return False
        self.command, self._candidate = self._candidate, self.command
        self.accepted += 1
        self._received = now
        self._source = offered.source
        return True

    def reject(self, reason: str, now: float) -> None:
        """Count a command rejected at `now` [s]; `reason` is a key of `REJECTIONS`."""
        self.rejections[reason] += 1
        self.last_rejection = reason
        self.last_rejection_time = now

    def _origin_fault(self, age_of_stamp: float, now: float, source: Source) -> str:
        """Return the reason if age or publisher of a command forbid it, otherwise ''."""
        # Other publishers are rejected while the last command of a publisher is valid.
        if source is None or (source != self._source and self.is_fresh(now)):
            return 'source'
        if not age_of_stamp <= self._settings.stamp_age_max:
            return 'stale'
        return 'future' if age_of_stamp < -_CLOCK_TOLERANCE else ''

    def _content_fault(self, offered: OfferedCommand) -> str:
        """Copy the values of a command; return the reason if one is invalid, otherwise ''."""
        names = offered.names
        key = names if type(names) is tuple else tuple(names)
        if key not in self._orders and not self._learn_order(key):
            return 'names'
        order = self._orders[key]
        rows = self._candidate.rows
        for row, values in enumerate((offered.position, offered.velocity, offered.effort)):
            if values is None or len(values) == 0:
                rows[row] = np.nan
            elif len(values) != len(self._names):
                return 'length'
            else:
                rows[row] = values
        if order is not None:
            rows[:] = rows[:, order]
        # Lists are faster than arrays for so few values. The comparison detects NaN, which
        # differs from itself.
        positions, velocities, efforts = lists = rows.tolist()
        for joint, effort in enumerate(efforts):
            if (
                effort != effort
                and positions[joint] != positions[joint]
                and velocities[joint] != velocities[joint]
            ):
                return 'nan'
        for numbers in lists:
            if inf in numbers or -inf in numbers:
                return 'infinite'
        if not self._effort_supported and any(effort == effort for effort in efforts):
            return 'unsupported'
        return ''

    def _learn_order(self, names: tuple[str, ...]) -> bool:
        """Store, per joint of the arm, its index in `names`; return False if a joint is missing."""
        if len(names) != len(self._names) or set(names) != set(self._names):
            return False
        if len(self._orders) >= _ORDERS_KEPT:
            self._orders = {self._names: None}
        self._orders[names] = np.array([names.index(name) for name in self._names])
        return True
