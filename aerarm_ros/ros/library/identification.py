"""Identification in one call."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy.typing as npt

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import STANDARD_GRAVITY, Robot, load_robot
from aerarm_ros.identification.identify import IdentificationOptions
from aerarm_ros.identification.identify import identify as run
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.identification.recording.recording import (
    JointMapping,
    Recording,
    recording_from_states,
)
from aerarm_ros.identification.stopwatch import Stopwatch
from aerarm_ros.ros.library.identified_arm import IdentifiedArm
from aerarm_ros.ros.library.motions import NUMBERED, Motion
from aerarm_ros.ros.programs.identifier_bags import (
    IdentifierBags,
    bag_names,
    repeated_bags,
)

Bag = str | os.PathLike[str] | Motion
"""A bag's or a table's path, or a motion."""


def identify(
    bags: Bag | Iterable[Bag],
    urdf: str | os.PathLike[str] | Robot | None = None,
    *,
    validation: Bag | Iterable[Bag] = (),
    holdout: float = 0.0,
    config: str | os.PathLike[str] | None = None,
    topic: str = '/joint_states',
    rename: Mapping[str, str] | None = None,
    lock: str | Sequence[str] = (),
    ignore: str | Sequence[str] = (),
    effort_gain: Mapping[str, float] | None = None,
    gravity: npt.ArrayLike | None = None,
    cutoff: float | None = None,
    options: IdentificationOptions | None = None,
) -> IdentifiedArm:
    """Identify an arm from recorded motion, as the identifier does.

    Parameters
    ----------
    bags : path or Motion, or several of them
        To identify from.
    urdf : path or Robot, optional
        Of the arm; this package's by default.
    validation : path or Motion, or several of them
        Only predicted.
    holdout : float
        Last share of each bag that is only predicted.
    config : path, optional
        Motors and gears; known for this package's arm.
    topic : str
        Of JointStates in bags.
    rename : mapping, optional
        Joint of the bags to joint of the URDF.
    lock, ignore : str or sequence of str
        Joints of the URDF that do not move; joints of the bags that the arm doesn't have.
    effort_gain : mapping, optional
        Joint to the factor that makes torque [Nm] of its effort.
    gravity : (3,) array_like, optional
        In the base frame [m/s^2].
    cutoff : float, optional
        Of the low-pass on torque [Hz]; chosen by the data otherwise.
    options : IdentificationOptions, optional
        Filters, friction model, solvers, bounds.

    Raises
    ------
    BagError, ConfigError, DescriptionError, IdentificationError
        If something can't be used; the message says what to check.
    """
    if not 0.0 <= holdout < 1.0:
        raise IdentificationError(f'holdout = {holdout:g} must lie in 0 .. 1')
    known = urdf is None or config is not None
    arm = load_arm_config(None if config is None else Path(config)) if known else None
    robot = _robot(urdf, _words(lock), gravity, arm.gravity_in_base if arm else STANDARD_GRAVITY)
    mapping = JointMapping(rename or {}, _words(ignore), _words(lock), effort_gain)
    reader = IdentifierBags(topic, robot.joint_names, mapping)
    groups = _listed('bags', bags), _listed('validation', validation)
    if not groups[0]:
        raise IdentificationError('no bag to identify from')
    paths = [[Path(bag) for bag in group if not isinstance(bag, Motion)] for group in groups]
    names = bag_names([*paths[0], *paths[1]])
    first, second = (
        [
            _of_motion(f'{word} {index}', bag, robot, mapping)
            if isinstance(bag, Motion)
            else reader.read(Path(bag), names[Path(bag)]).recording
            for index, bag in enumerate(group, 1)
        ]
        for word, group in zip(('motion', 'validation motion'), groups, strict=True)
    )
    reader.messages += repeated_bags(*paths)
    if holdout > 0.0:
        second += [bag.part(1.0 - holdout, 1.0, ' [held out]') for bag in first]
        first = [bag.part(0.0, 1.0 - holdout, ' [identified]') for bag in first]
    chosen = options or IdentificationOptions()
    if cutoff is not None:
        chosen = replace(chosen, conditioning=replace(chosen.conditioning, cutoff=cutoff))
    stopwatch = Stopwatch()
    result = run(robot, arm, first, second, chosen, stopwatch)
    result.warnings[:0] = reader.messages
    return IdentifiedArm(result, stopwatch.seconds)


def _listed(word: str, bags: Bag | Iterable[Bag]) -> list[Bag]:
    """Return one or several bags as a list, checked."""
    one = not isinstance(bags, Iterable) or isinstance(bags, str | os.PathLike | Motion)
    listed: list[Bag] = [bags] if one else list(bags)  # type: ignore[list-item, arg-type]
    for bag in listed:
        if not isinstance(bag, str | os.PathLike | Motion):
            raise IdentificationError(
                f'{word}: {type(bag).__name__} is neither a path nor a motion: '
                'from_arrays(time, q, tau) makes one of arrays'
            )
    return listed


def _words(names: str | Sequence[str]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


def _robot(
    urdf: str | os.PathLike[str] | Robot | None,
    lock: tuple[str, ...],
    gravity: npt.ArrayLike | None,
    known_gravity: npt.ArrayLike,
) -> Robot:
    if isinstance(urdf, Robot):
        if lock:
            raise IdentificationError(
                f'lock = {", ".join(lock)}: goes with the path of a URDF; else '
                'load_robot(urdf, locked=...) makes the robot to give'
            )
        return urdf if gravity is None else urdf.with_gravity(gravity)
    path = None if urdf is None else Path(urdf)
    pull = known_gravity if gravity is None else gravity
    return load_robot(path, gravity_in_base=pull, locked=list(lock))


def _of_motion(name: str, motion: Motion, robot: Robot, mapping: JointMapping) -> Recording:
    if motion.names == NUMBERED[: robot.n]:  # numbers are counted from the base
        motion = replace(motion, names=robot.joint_names)
    return recording_from_states(name, motion, robot.joint_names, mapping)
