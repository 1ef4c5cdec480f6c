"""Checked recording of one arm motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.recording.signal_checks import (
    check_stamp_unit,
    check_units,
    saturated_effort,
    usable_messages,
    without_spikes,
)
from aerarm_ros.identification.recording.table_file import TableStates
from aerarm_ros.motion.signals import Array

# tolerated fraction of missed bridge cycles; filters remove the effect of single long steps
_MISSED_MAX = 0.01


@dataclass(frozen=True)
class BagFacts:
    """Facts about a bag for the report: used part, lost messages and missed cycles.

    Attributes
    ----------
    used : str
        Description of the part of the bag that is used.
    lost : int or None
        Number of missing joint states between first and last; None without sequence numbers.
    missed_cycles : int or None
        Number of cycles that the bridge missed; None if the bag has no diagnostics.
    columns : str
        Names of the table columns of each joint; empty for a bag.
    """

    used: str
    lost: int | None = None
    missed_cycles: int | None = None
    columns: str = ''

    @property
    def text(self) -> str:
        """Text on the used part of the bag, lost messages and missed cycles, for a terminal."""
        parts = [f'used {self.used}']
        if self.lost is not None:
            parts.append(f'{self.lost} states lost')
        if self.missed_cycles is not None:
            parts.append(f'{self.missed_cycles} cycles missed')
        columns = f'\n  columns: {self.columns}' if self.columns else ''
        return ', '.join(parts) + columns

    def warnings(self, name: str, states: int) -> list[str]:
        """Return warnings about the recording of the bag.

        Parameters
        ----------
        name : str
            Name of the bag.
        states : int
            Number of joint states in the bag, one per executed cycle.
        """
        missed = self.missed_cycles or 0
        share = missed / max(states + (self.lost or 0) + missed, 1)
        if share <= _MISSED_MAX:
            return []
        return [
            f'{name}: {100.0 * share:.2g} % of the cycles were missed, so torque and velocity '
            'are sampled at irregular steps; give the bridge real-time priority (as in '
            'config/parameters_spi.yaml), or end other processes'
        ]


RUNNING = 'running'
"""Mode in which the bridge follows commands."""

# An encoder count of a coarse drive is about 1e-4 rad; smaller changes are not motion.
_SMALLEST_MOTION = 1e-3  # [rad] within which a joint counts as resting
_MARGIN = 0.5  # [s] kept at both ends of a motion, for the filters' transients
_LONGEST_PAUSE = 0.5  # [s] longest time between two commands of one motion
_LOOKS = 1000  # number of positions used to measure travel; with all positions, noise would add up


@dataclass(frozen=True)
class UsedSpan:
    """Part of a bag that is used for the identification.

    Attributes
    ----------
    first, last : float
        Start and end [s] since the bag's first state.
    whole : float
        Duration of the bag [s].
    reason : str
        Reason why this part was chosen.
    """

    first: float
    last: float
    whole: float
    reason: str

    @property
    def text(self) -> str:
        """Short description for reports."""
        return f'{self.first:.1f} .. {self.last:.1f} s of {self.whole:.1f} s ({self.reason})'


def running_span(
    time: Array, q: Array, modes: Sequence[tuple[float, str]]
) -> tuple[slice, str] | None:
    """Return the rows in which the arm follows commands, according to the bridge's modes.

    In the modes idle, aligning, ready and damping the arm does not follow commands: it rests, is
    moved by the boards, or sinks.

    Parameters
    ----------
    time : (M,) ndarray
        Receipt time of the joint states [s].
    q : (M, n) ndarray
        Joint positions [rad].
    modes : sequence of (time, mode)
        Receipt times [s] in ascending order, each with the mode of the bridge.

    Returns
    -------
    slice and reason, or None if no mode is known or the arm never followed commands. Of several
    sections the one with most motion is chosen.
    """
    runs = []
    for index, (begin, mode) in enumerate(modes):
        if mode != RUNNING:
            continue
        # The first mode was active when recording began.
        first = 0 if index == 0 else int(np.searchsorted(time, begin))
        end = modes[index + 1][0] if index + 1 < len(modes) else np.inf
        last = int(np.searchsorted(time, end))
        if last - first > 1:
            runs.append(slice(first, last))
    return _longest_travel(q, runs, f'arm_mode {RUNNING}')


def commanded_span(stamp: Array, q: Array, commands: Array) -> tuple[slice, str] | None:
    """Return the rows of the joint states that were recorded while commands arrived.

    Parameters
    ----------
    stamp : (M,) ndarray
        Stamps of the joint states [s].
    q : (M, n) ndarray
        Joint positions [rad].
    commands : (K,) ndarray
        Stamps of the commands [s].
    """
    commands = np.sort(commands[np.isfinite(commands)])
    if len(commands) < 2:
        return None
    steps = np.diff(commands)
    pauses = np.flatnonzero(steps > max(_LONGEST_PAUSE, 5.0 * float(np.median(steps))))
    begins = commands[np.concatenate(([0], pauses + 1))]
    ends = commands[np.concatenate((pauses, [len(commands) - 1]))]
    runs = []
    for begin, end in zip(begins, ends, strict=True):
        inside = np.flatnonzero((stamp >= begin) & (stamp <= end))
        if len(inside) > 1:
            runs.append(slice(int(inside[0]), int(inside[-1]) + 1))
    return _longest_travel(q, runs, 'joint_command')


def moving_span(time: Array, q: Array) -> tuple[slice, str]:
    """Return the rows from the start of the first to the end of the last motion, with a margin."""
    # made monotonic, because another check reports times that run backwards
    time = np.maximum.accumulate(time)
    ends = [end for column in q.T if (end := _ends_of_motion(column)) is not None]
    if not ends:
        return slice(0, len(q)), 'whole bag'
    left, arrived = min(first for first, _ in ends), max(last for _, last in ends)
    first = int(np.searchsorted(time, time[left] - _MARGIN))
    last = int(np.searchsorted(time, time[arrived] + _MARGIN, side='right'))
    whole = first == 0 and last >= len(q)
    return slice(first, last), 'whole bag' if whole else 'motion'


def _ends_of_motion(q: Array) -> tuple[int, int] | None:
    """Return the rows at which the motion begins and ends; None without motion."""
    finite = np.isfinite(q)
    if not finite.any():
        return None
    first, last = q[np.argmax(finite)], q[len(q) - 1 - np.argmax(finite[::-1])]
    away = finite & (np.abs(q - first) > _SMALLEST_MOTION)
    to_go = finite & (np.abs(q - last) > _SMALLEST_MOTION)
    if not (away.any() and to_go.any()):
        return None
    return int(np.argmax(away)), len(q) - 1 - int(np.argmax(to_go[::-1]))


def _longest_travel(q: Array, runs: Sequence[slice], reason: str) -> tuple[slice, str] | None:
    """Return the section with the longest joint travel, None if no joint moves in any section."""
    travel = [_travel(q[run]) for run in runs]
    if not travel or max(travel) < _SMALLEST_MOTION:
        return None
    if len(runs) > 1:
        reason = f'{reason}, the longest of {len(runs)} motions'
    return runs[int(np.argmax(travel))], reason


def _travel(q: Array) -> float:
    thinned = q[:: max(1, len(q) // _LOOKS)]
    return float(np.nansum(np.abs(np.diff(thinned, axis=0))))


# [rad] or [m] tolerated motion of a locked joint: a locked joint yields, and fingers close
# slightly
_LOCKED_MOTION = 0.05
_FEWEST_MESSAGES = 20
_LARGEST = 1e6  # [rad], [rad/s], [Nm]: beyond any arm, with finite squares


@dataclass(frozen=True)
class JointMapping:
    """Mapping of joints in a bag to joints in the URDF.

    Attributes
    ----------
    rename : mapping
        Name in the URDF for each joint name in the bag.
    ignored : tuple of str
        Joints of the bag (named after renaming) that are not in the URDF.
    locked : tuple of str
        Joints of the URDF that do not move; the bag may contain them.
    prefix : str
        Prefix of the joint names in the bag that the URDF lacks.
    effort_gain : mapping
        Factor by joint name that converts recorded effort to torque [Nm], for example in Nm/A.
    """

    rename: Mapping[str, str]
    ignored: tuple[str, ...] = ()
    locked: tuple[str, ...] = ()
    effort_gain: Mapping[str, float] | None = None
    prefix: str = ''

    def own_name(self, name: str) -> str:
        """Return the URDF name of a joint in the bag."""
        return self.rename.get(name, name.removeprefix(self.prefix))


@dataclass(frozen=True, eq=False)
class Recording:
    """Motion and torque of an arm's n joints, in chain order.

    Attributes
    ----------
    name : str
        Name in tables and messages.
    time : (M,) ndarray
        Strictly increasing time [s] since the bag's start.
    q, dq, tau : (M, n) ndarray
        Positions [rad], velocities [rad/s], torques [Nm]. `dq` is None if the bag has no
        velocities.
    dead_effort : (n,) ndarray of bool
        Joints whose recorded torque is constant and therefore not used.
    warnings : tuple of str
        Warnings about excluded or implausible data.
    start : float
        Stamp of time 0 [s].
    span : UsedSpan or None
        Part of the bag that is used; None if the recording was not read from a bag or table.
    saturated : (M, n) ndarray of bool or None
        Samples with effort at its limit; None without any.
    """

    name: str
    joint_names: tuple[str, ...]
    time: Array
    q: Array
    dq: Array | None
    tau: Array
    dead_effort: npt.NDArray[np.bool_]
    warnings: tuple[str, ...] = ()
    start: float = 0.0
    span: UsedSpan | None = None
    saturated: npt.NDArray[np.bool_] | None = None

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.time[-1] - self.time[0])

    def part(self, first: float, last: float, suffix: str) -> 'Recording':
        """Return the part of the recording between two fractions (0 to 1) of its duration."""
        low, high = (self.time[0] + share * self.duration for share in (first, last))
        end = None if last >= 1.0 else int(np.searchsorted(self.time, high))
        inside = slice(int(np.searchsorted(self.time, low)), end)
        return replace(
            self,
            name=f'{self.name}{suffix}',
            time=self.time[inside],
            q=self.q[inside],
            dq=None if self.dq is None else self.dq[inside],
            tau=self.tau[inside],
            dead_effort=np.ptp(self.tau[inside], axis=0) == 0.0,
            saturated=None if self.saturated is None else self.saturated[inside],
        )


def recording_from_states(
    name: str,
    states: TableStates,
    joint_names: Sequence[str],
    mapping: JointMapping,
    commanded: tuple[slice, str] | None = None,
    whole: bool = False,
) -> Recording:
    """Return the recording of an arm's joints from joint states, after checking the values.

    Parameters
    ----------
    name : str
        Name of the bag, for messages.
    states : TableStates
        Joint states read from the bag.
    joint_names : sequence of str
        Joints of the arm, from base to tool.
    mapping : JointMapping
        Renaming, excluded joints, effort gains.
    commanded : slice and reason, optional
        Messages received while the arm followed commands, with the reason; other messages are
        ignored. Rest before and after the motion is excluded as well.
    whole : bool
        Whether to use all messages, including rest; then no joint has to move.

    Raises
    ------
    IdentificationError
        If there are too few messages, or a joint is missing, unknown, or locked and moving. Also if
        stamps repeat, jump or are not in seconds, if position or effort is missing or NaN, if
        nothing moves, or if units are wrong.
    """
    order = np.array(_columns(name, states.names, joint_names, mapping))
    if len(states.stamp) < _FEWEST_MESSAGES:
        raise IdentificationError(
            f'{name} contains only {len(states.stamp)} joint states, too few for an '
            'identification: record a longer motion'
        )
    check_stamp_unit(name, states.stamp)
    rows, reason = slice(0, len(states.stamp)), 'whole bag'
    if not whole:
        rows, reason = _used_rows(states, order, commanded)
    _check_locked(name, states.names, states.position[rows], mapping)
    kept, warnings = usable_messages(name, states.stamp[rows], float(states.stamp[0]))
    stamp = states.stamp[rows][kept]
    q, measured_dq, tau = (
        _taken(values[rows], kept, order)
        for values in (states.position, states.velocity, states.effort)
    )
    _check_complete(name, 'position', q, joint_names, stamp)
    _check_complete(name, 'effort', tau, joint_names, stamp)
    if mapping.effort_gain:
        tau = tau * np.array([mapping.effort_gain.get(joint, 1.0) for joint in joint_names])
    rests = whole and np.ptp(q, axis=0).max() < _SMALLEST_MOTION
    dq = measured_dq if rests and not measured_dq.any() else _velocity(name, measured_dq, warnings)
    check_units(name, joint_names, stamp, q, dq)
    dead = (
        np.ptp(tau, axis=0) == 0.0 if whole else _check_content(name, joint_names, q, tau, warnings)
    )
    tau, spikes = without_spikes(name, joint_names, tau)
    saturated, limits = saturated_effort(name, joint_names, q, tau)
    warnings += spikes + limits
    # Times count from the bag's start, independent of the used part.
    start = float(states.stamp[0])
    time = stamp - start
    span = UsedSpan(float(time[0]), float(time[-1]), float(states.stamp[-1]) - start, reason)
    names = tuple(joint_names)
    notes = tuple(warnings)
    return Recording(name, names, time, q, dq, tau, dead, notes, start, span, saturated)


def _used_rows(
    states: TableStates, order: Array, commanded: tuple[slice, str] | None
) -> tuple[slice, str]:
    """Return the rows of the messages to use, and the reason for the choice."""
    part, reason = commanded or (slice(0, len(states.stamp)), 'motion')
    moving, how = moving_span(states.stamp[part], states.position[part][:, order])
    if how != 'motion' and commanded is None:
        reason = how
    return slice(part.start + moving.start, part.start + moving.stop), reason


def _check_locked(bag: str, names: Sequence[str], position: Array, mapping: JointMapping) -> None:
    """Raise an error if a locked joint of the URDF moves in the bag."""
    for name, q in zip(names, position.T, strict=True):
        joint = mapping.own_name(name)
        if joint not in mapping.locked:
            continue
        q = q[np.abs(q) < _LARGEST]
        if len(q) and np.ptp(q) > _LOCKED_MOTION:
            raise IdentificationError(
                f'joint {joint} is locked (--lock) but moves by {np.ptp(q):.3g} rad in {bag}: '
                f'remove --lock {joint}, or shorten the bag to the part in which the joint rests'
            )


def _taken(values: Array, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> Array:
    """Return selected rows and columns of an array; if all are selected, the array itself."""
    whole = all(
        np.array_equal(index, np.arange(size))
        for index, size in zip((rows, columns), values.shape, strict=True)
    )
    return values if whole else values[np.ix_(rows, columns)]


def _columns(
    bag: str, names: Sequence[str], joint_names: Sequence[str], mapping: JointMapping
) -> list[int]:
    renamed = [mapping.own_name(name) for name in names]
    known = (*joint_names, *mapping.ignored, *mapping.locked)
    recorded, arm = ', '.join(names), ', '.join(joint_names)
    for what, wrong, text in (
        (
            'joint',
            [name for name in mapping.rename if name not in names],
            f'(--rename) is not in {bag}: choose from {recorded}',
        ),
        (
            'joints',
            [name for name in joint_names if name not in renamed],
            f"of the URDF are not in {bag}, which has {recorded}: rename the bag's joints "
            '(--tf-prefix, --rename BAG=URDF), lock joints of the URDF (--lock JOINT), or pass the '
            'URDF of the recorded arm',
        ),
        (
            f'several joints of {bag} are called',
            [name for name in dict.fromkeys(renamed) if renamed.count(name) > 1],
            'after renaming: check --rename',
        ),
        (
            'joints',
            [name for name in renamed if name not in known],
            f'of {bag} are missing from the URDF, which has {arm}: pass the URDF of the recorded '
            'arm, or ignore these joints (--ignore JOINT)',
        ),
        (
            'joint',
            [name for name in mapping.ignored if name not in renamed],
            f'(--ignore) is not in {bag}: choose from {", ".join(renamed)}',
        ),
    ):
        if wrong:
            raise IdentificationError(f'{what} {", ".join(wrong)} {text}')
    return [renamed.index(name) for name in joint_names]


def _check_complete(
    bag: str, field: str, values: Array, joints: Sequence[str], stamp: Array
) -> None:
    """Raise an error if values of a field are missing, not finite or impossible."""
    bad = ~(np.abs(values) < _LARGEST)
    if not bad.any():
        return
    names = ', '.join(joint for joint, column in zip(joints, bad.T, strict=True) if column.any())
    if np.isnan(values).all(axis=0).any():
        raise IdentificationError(
            f'{bag} has no {field} of joints {names}: check the publisher of the topic, or '
            'choose another topic with --topic'
        )
    rows = np.flatnonzero(bad.any(axis=1))
    if np.isfinite(values).all():
        what = f'reaches {np.abs(values).max():.3g}'
        advice = 'units and the driver that published the messages'
    else:
        what = 'is NaN or infinite'
        advice = 'the driver that published the messages, or record again'
    raise IdentificationError(
        f'{field} of joints {names} in {bag} {what} in {len(rows)} of {len(values)} messages, '
        f'first {stamp[rows[0]] - stamp[0]:.3f} s after the start of the motion: check {advice}'
    )


def _velocity(bag: str, dq: Array, warnings: list[str]) -> Array | None:
    if not (np.abs(dq) < _LARGEST).all():
        warnings.append(
            f'{bag}: velocities are missing or NaN, so positions are differentiated instead'
        )
        return None
    if not dq.any():
        warnings.append(f'{bag}: velocities are all zero, so positions are differentiated instead')
        return None
    return dq


def _check_content(
    bag: str, joints: Sequence[str], q: Array, tau: Array, warnings: list[str]
) -> npt.NDArray[np.bool_]:
    still = np.ptp(q, axis=0) < _SMALLEST_MOTION
    if still.all():
        raise IdentificationError(
            f'no joint moves in {bag}: record an excitation trajectory, with the drives enabled'
        )
    dead = np.ptp(tau, axis=0) == 0.0
    if dead.all():
        raise IdentificationError(
            f'the effort of every joint in {bag} is constant: check that the drives report '
            'torque or current'
        )
    for states, text in (
        (still, 'does not move, so its friction cannot be identified'),
        (dead, 'has a constant effort, so its torque is ignored'),
    ):
        warnings += [
            f'{bag}: joint {joint} {text}'
            for joint, state in zip(joints, states, strict=True)
            if state
        ]
    return np.asarray(dead, dtype=bool)
