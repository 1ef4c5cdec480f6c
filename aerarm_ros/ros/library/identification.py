"""Python functions that read recorded motion and identify an arm."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aerarm_msgs_py.bags.bag_reader import read_contents
from aerarm_msgs_py.storage.read_limits import BagError as BagError
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import STANDARD_GRAVITY, Robot, load_robot
from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.estimate_file import estimated_arm, read_estimate
from aerarm_ros.identification.files.result_directory import ResultDirectory
from aerarm_ros.identification.files.summary import ReportExtras, export_errors, summarise
from aerarm_ros.identification.identification_result import BagAssessment, IdentificationResult
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch
from aerarm_ros.identification.identify import identify as run
from aerarm_ros.identification.recording.recording import (
    JointMapping,
    Recording,
    recording_from_states,
)
from aerarm_ros.identification.recording.table_file import (
    TABLES,
    TableOptions,
    TableStates,
    read_table,
)
from aerarm_ros.identification.report_tables import error_table, parameter_table
from aerarm_ros.identification.solvers.estimate import Estimate
from aerarm_ros.model.regressor import Regressor
from aerarm_ros.motion.signals import Array
from aerarm_ros.pages.html_text import bullets, paragraph
from aerarm_ros.ros.programs.identifier_bags import (
    IdentifierBags,
    bag_names,
    hold_out,
    repeated_bags,
)
from aerarm_ros.ros.programs.identifier_run import RESULT_FILES, terminal_table, write_result


class IdentifiedModel:
    """Complete dynamic model of an identified arm: links, rotors, friction and gravity.

    Parameters
    ----------
    robot : Robot
        Arm with the gravity of the model. The links of the estimate replace the links of `robot`.

    Attributes
    ----------
    robot : Robot
        Arm with the links of the estimate.
    """

    def __init__(self, robot: Robot, estimate: Estimate) -> None:
        self.robot = robot.with_inertial_parameters(estimate.inertial)
        self.estimate = estimate
        self._regressor = Regressor(robot)

    def torque(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike, *, is_motion: bool = False
    ) -> Array:
        """Return the joint torque of links, rotors and friction, equation (3.5) of the thesis.

        Parameters
        ----------
        q, dq, ddq : (n,) or (M, n) array_like
            Positions [rad], velocities [rad/s] and accelerations [rad/s^2] of the joints.
        is_motion : bool
            Whether the rows are successive samples of one motion, so that friction can build up
            after a reversal. By default the friction of each row is that of steady motion.

        Returns
        -------
        (n,) or (M, n) ndarray
            Torque of each joint [Nm].

        Raises
        ------
        ValueError
            If q, dq and ddq have different shapes, or another number of joints than the arm.
        """
        motion = [np.asarray(values, dtype=float) for values in (q, dq, ddq)]
        shape = motion[0].shape
        n = self.robot.n
        is_known = shape[-1:] == (n,) and len(shape) <= 2
        if not is_known or any(values.shape != shape for values in motion):
            shapes = ', '.join(str(values.shape) for values in motion)
            raise ValueError(
                f'q, dq and ddq have the shapes {shapes}: pass arrays of shape ({n},) or (M, {n})'
            )
        rows = [values.reshape(-1, n) for values in motion]
        links = self._regressor.stack_rigid(*rows) @ self.estimate.inertial.ravel()
        path = rows[0] if is_motion else None
        torque = self.estimate.model.torque(self.estimate.theta, links, rows[1], rows[2], path)
        return torque.reshape(shape)


def load_identified(folder: str | os.PathLike[str]) -> IdentifiedModel:
    """Load the complete dynamic model from an output directory of the identifier.

    Parameters
    ----------
    folder : path
        Directory with the files `estimate.yaml` and `identified.urdf`.

    Raises
    ------
    ConfigError, DescriptionError, IdentificationError
        If a file cannot be read, or is not an output of the identifier.
    """
    path = Path(folder) / 'estimate.yaml'
    joints, gravity = estimated_arm(path)
    urdf = Path(folder) / 'identified.urdf'
    robot = load_robot(urdf, gravity_in_base=gravity, joint_names=joints)
    return IdentifiedModel(robot, read_estimate(path, robot))


class IdentifiedArm(IdentifiedModel):
    """Result of `identify`: the arm's model, and the errors of the predicted torque.

    Parameters
    ----------
    result : IdentificationResult
        Complete result of the identification.
    stopwatch : Stopwatch
        Duration of each stage of the identification.

    Attributes
    ----------
    estimate : Estimate
        Estimate of the arm's physically consistent parameters, with standard deviations.
    """

    def __init__(self, result: IdentificationResult, stopwatch: Stopwatch) -> None:
        super().__init__(result.robot, result.recommended.estimate)
        self.result = result
        self._stopwatch = stopwatch

    @property
    def parameters(self) -> dict[str, float]:
        """All identified parameters by name, such as `m_link1` or `fv_joint2`, in SI units."""
        names = self.estimate.model.columns
        return dict(zip(names, self.estimate.theta.tolist(), strict=True))

    @property
    def errors(self) -> list[BagAssessment]:
        """Torque errors per validation bag; without validation bags, per identification bag."""
        recommended = self.result.recommended
        return recommended.validation or recommended.identification

    @property
    def warnings(self) -> list[str]:
        """Warnings about the validity of the identified model, with advice."""
        return list(self.result.warnings)

    def summary(self) -> str:
        """Return a text with each solver's torque error on each bag, and with the warnings."""
        lines = [terminal_table(self.result, {})]
        return '\n'.join(lines + [f'- {text}' for text in self.warnings])

    def as_dict(self) -> dict[str, object]:
        """Return the most important results, as in the file `summary.json` of the identifier."""
        extras = ReportExtras(exports=export_errors(self.result))
        return summarise(self.result, self._stopwatch.seconds, extras)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the output files of the identifier: YAML, URDF, MJCF, SDF, JSON and an HTML report.

        Parameters
        ----------
        folder : path
            New or empty directory, or a directory with an earlier result, which is replaced.

        Raises
        ------
        IdentificationError
            If the directory cannot be written or contains other files.
        """
        with ResultDirectory(Path(folder), 'save(folder)', RESULT_FILES) as directory:
            extras = ReportExtras(exports=export_errors(self.result))
            write_result(self.result, directory, extras, self._stopwatch)
        return directory.target

    def __repr__(self) -> str:
        """Return a short text with the largest torque error of all bags."""
        worst = max(self.errors, key=lambda bag: bag.filtered)
        return (
            f'<IdentifiedArm {self.result.robot.model.name}: torque error {worst.filtered:.2f} % '
            f'filtered, {worst.filtered_measured:.2f} % with only the measured torque filtered, '
            f'{worst.raw:.2f} % raw, on bag {worst.bag}>'
        )

    def _repr_html_(self) -> str:
        """Return HTML tables of torque errors and parameters, for a notebook."""
        parts = [error_table(self.result)]
        if self.warnings:
            parts.append(bullets(self.warnings, 'warnings'))
        parts += [paragraph(f'{self.result.samples} samples'), parameter_table(self.result, None)]
        return ''.join(parts)


Motion = TableStates
"""Recorded motion of n joints: names, stamps (M,), and positions, velocities, efforts (M, n)."""

NUMBERED = tuple(f'joint{i}' for i in range(1, 33))
"""Joint names, from base to tool, for a recording without joint names."""


def read_bag(
    path: str | os.PathLike[str],
    topic: str = '/joint_states',
    *,
    rate: float | None = None,
    degrees: bool = False,
    numbered_from: int | None = None,
) -> Motion:
    """Read the joint states in a bag or a table file as arrays.

    Parameters
    ----------
    path : path
        rosbag2 directory, .mcap, .db3, .csv or .npz file, or .bag of ROS 1.
    topic : str
        JointState topic in the bag.
    rate : float, optional
        Rate of the rows [Hz], for a table without a column of time.
    degrees : bool
        Whether the angles of a table are in degrees.
    numbered_from : {0, 1}, optional
        Number of the first joint in a table's columns; detected from the columns by default.

    Raises
    ------
    BagError, IdentificationError
        If the file cannot be read; the message states what to check.
    """
    file = Path(path)
    if file.suffix.lower() in TABLES:
        return read_table(file, NUMBERED, TableOptions(rate, degrees, numbered_from))
    name = '/' + topic.lstrip('/')
    states = read_contents(file, name).joint_states[name]
    return Motion(
        tuple(states.names), states.stamp, states.position, states.velocity, states.effort
    )


def from_arrays(
    time: npt.ArrayLike,
    q: npt.ArrayLike,
    tau: npt.ArrayLike,
    dq: npt.ArrayLike | None = None,
    names: Sequence[str] | None = None,
) -> Motion:
    """Create a recorded motion from arrays or lists.

    Parameters
    ----------
    time : (M,) array_like
        Time of each sample [s].
    q, tau : (M, n) array_like
        Positions [rad] and torques [Nm].
    dq : (M, n) array_like, optional
        Velocities [rad/s]; by default the differentiated positions.
    names : sequence of n str, optional
        Names of the joints; joint1, joint2 ... by default.

    Raises
    ------
    IdentificationError
        If an array has the wrong shape.
    """
    stamp = _numbers('time', time, (None,))
    position = _numbers('q', q, (len(stamp), None))
    joints = NUMBERED[: position.shape[1]] if names is None else tuple(names)
    if len(joints) != position.shape[1]:
        raise IdentificationError(
            f'q has {position.shape[1]} columns, but names has {len(joints)} joint names: pass one '
            'name per column'
        )
    effort = _numbers('tau', tau, position.shape)
    velocity = np.full_like(position, np.nan) if dq is None else _numbers('dq', dq, position.shape)
    return Motion(joints, stamp, position, velocity, effort)


def _numbers(word: str, values: npt.ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """Return `values` as an array of this shape, in which None is any length; raise otherwise."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        raise IdentificationError(
            f'{word} is not an array of numbers: pass numbers, in rows of equal length'
        ) from None
    wanted = tuple(n if m is None else m for m, n in zip(shape, array.shape, strict=False))
    if len(array.shape) != len(shape) or array.shape != wanted:
        text = ', '.join('any' if m is None else str(m) for m in shape)
        raise IdentificationError(
            f'{word} has the shape {array.shape}: pass an array of shape ({text}), with one row '
            'per sample'
        )
    return array


Bag = str | os.PathLike[str] | Motion
"""Path of a bag or table file, or a recorded motion."""


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
    """Identify an arm from recorded motion, as the executable `identifier` does.

    Parameters
    ----------
    bags : path or Motion, or several of them
        Recordings for the identification.
    urdf : path or Robot, optional
        Model of the arm; this package's arm by default.
    validation : path or Motion, or several of them
        Recordings for the validation only.
    holdout : float
        Fraction at the end of each bag that is used for validation only.
    config : path, optional
        File with motors and gears; not needed for this package's arm.
    topic : str
        JointState topic in the bags.
    rename : mapping, optional
        Name of a joint in the URDF, by its name in the bags.
    lock, ignore : str or sequence of str
        `lock`: joints of the URDF that do not move. `ignore`: joints of the bags that are not in
        the URDF.
    effort_gain : mapping, optional
        Factor that converts a joint's recorded effort to torque [Nm], by joint name.
    gravity : (3,) array_like, optional
        Gravity in the base frame [m/s^2].
    cutoff : float, optional
        Cut-off frequency of the low-pass on torque [Hz]; selected from the data by default.
    options : IdentificationOptions, optional
        Settings of filters, friction model, solvers and bounds.

    Raises
    ------
    BagError, ConfigError, DescriptionError, IdentificationError
        If an input cannot be used; the message states what to check.
    """
    if not 0.0 <= holdout < 1.0:
        raise IdentificationError(
            f'holdout = {holdout:g} is invalid: pass a fraction of at least 0 and below 1'
        )
    known = urdf is None or config is not None
    arm = load_arm_config(None if config is None else Path(config)) if known else None
    robot = _robot(urdf, _words(lock), gravity, arm.gravity_in_base if arm else STANDARD_GRAVITY)
    mapping = JointMapping(rename or {}, _words(ignore), _words(lock), effort_gain)
    reader = IdentifierBags(topic, robot.joint_names, mapping)
    groups = _listed('bags', bags), _listed('validation', validation)
    if not groups[0]:
        raise IdentificationError(
            'the argument bags is empty: pass at least one bag, table or motion'
        )
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
    first, held_out = hold_out(first, holdout)
    chosen = options or IdentificationOptions()
    if cutoff is not None:
        chosen = replace(chosen, conditioning=replace(chosen.conditioning, cutoff=cutoff))
    stopwatch = Stopwatch()
    result = run(robot, arm, first, second + held_out, chosen, stopwatch)
    result.warnings[:0] = reader.messages
    return IdentifiedArm(result, stopwatch)


def _listed(word: str, bags: Bag | Iterable[Bag]) -> list[Bag]:
    """Return one or several bags as a list; raises IdentificationError for other objects."""
    one = not isinstance(bags, Iterable) or isinstance(bags, str | os.PathLike | Motion)
    listed: list[Bag] = [bags] if one else list(bags)  # type: ignore[list-item, arg-type]
    for bag in listed:
        if not isinstance(bag, str | os.PathLike | Motion):
            raise IdentificationError(
                f'{word} contains an object of type {type(bag).__name__}, which is neither a path '
                'nor a motion: convert arrays to a motion with from_arrays(time, q, tau)'
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
                f'lock = {", ".join(lock)} is possible only if urdf is a path: pass '
                'load_robot(urdf, locked=...) as urdf instead'
            )
        return urdf if gravity is None else urdf.with_gravity(gravity)
    path = None if urdf is None else Path(urdf)
    pull = known_gravity if gravity is None else gravity
    return load_robot(path, gravity_in_base=pull, locked=list(lock))


def _of_motion(name: str, motion: Motion, robot: Robot, mapping: JointMapping) -> Recording:
    if motion.names == NUMBERED[: robot.n]:  # Numbers count from the base.
        motion = replace(motion, names=robot.joint_names)
    return recording_from_states(name, motion, robot.joint_names, mapping)
