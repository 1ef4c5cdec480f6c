"""Arm motions that disturb the drone, and their sequence in a flight."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.resources import resource
from aerarm_ros.excitation.design_file import TrajectoryFile
from aerarm_ros.excitation.trajectory import MotionSequence, Stage
from aerarm_ros.motion.polynomial_path import PolynomialPath, smooth_step
from aerarm_ros.motion.signals import JointMotion, JointReference

HANGING = np.array([0.0, np.pi / 2, 0.0, 0.0])
RAMP = 2.0  # [s]


class Course(Protocol):
    """Motion of infinite duration."""

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference (M, n) at times (M,) [s]."""
        ...


class GrownMotion:
    """Displacement of a course from the hanging posture, scaled by a factor that rises and falls.

    Parameters
    ----------
    seconds : float
        Duration including both ramps [s].
    ramp : float
        Duration of each ramp [s].
    """

    def __init__(self, course: Course, seconds: float, ramp: float = RAMP) -> None:
        self.course = course
        self.duration, self.ramp = seconds, ramp

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference (M, n) at times (M,) [s]."""
        times = np.atleast_1d(time)
        here = times[:, None]
        ramp = self.ramp
        rise, fall = smooth_step(here / ramp), smooth_step((self.duration - here) / ramp)
        # At most one of the two factors differs from its final value.
        g = rise.value * fall.value
        dg = (rise.slope - fall.slope) / ramp
        ddg = (rise.curvature + fall.curvature) / ramp**2
        q, dq, ddq = self.course.evaluate(times)
        away = q - HANGING
        return JointReference(
            HANGING + g * away, dg * away + g * dq, ddg * away + 2.0 * dg * dq + g * ddq
        )

    def is_moving(self, times: np.ndarray) -> np.ndarray:
        """Return which times lie between the ramps."""
        return (times > self.ramp) & (times < self.duration - self.ramp)


MOTIONS = {  # amplitude [rad], frequency [Hz]
    'slow': (np.array([0.4, 0.5, 0.45, 0.5]), np.array([0.2, 0.25, 0.3, 0.35])),
    'fast': (np.array([0.5, 0.8, 0.6, 0.7]), np.array([0.5, 0.6, 0.75, 0.9])),
}


@dataclass(frozen=True, eq=False)
class Sines:
    """Sine motion of each joint about the hanging posture; amplitudes [rad], frequencies [Hz]."""

    amplitude: np.ndarray
    frequency: np.ndarray

    def evaluate(self, time: ArrayLike) -> JointReference:
        """Return the reference (M, n) at times (M,) [s]."""
        w = 2.0 * np.pi * self.frequency
        angle = np.multiply.outer(time, w)
        s, c = self.amplitude * np.sin(angle), self.amplitude * np.cos(angle)
        return JointReference(HANGING + s, w * c, -(w**2) * s)


class ArmSwing(GrownMotion):
    """Sine motion of each joint, with ramps from rest and to rest.

    Parameters
    ----------
    motion : str
        Key of `MOTIONS`.
    seconds, ramp : float
        See `GrownMotion`.
    """

    def __init__(self, motion: str, seconds: float, ramp: float = RAMP) -> None:
        super().__init__(Sines(*MOTIONS[motion]), seconds, ramp)


_PART_RAMP = 1.0  # [s]
STILL = 'no arm motion'
PARTS = 'slow', 'reach', 'fast', 'excitation', '0.2 kg picked up'
PAYLOAD = [0.2, 0.1, 0.0, 0.0]  # [kg], and its position in the last joint's frame [m], at the tool
_STRETCHED = HANGING - [0.0, np.pi / 2, 0.0, 0.0]
_QUICK = 1.5  # [s] duration of a reach of 90 degrees
_REST = 0.5  # [s] after the reach


@dataclass(frozen=True)
class FlightPart:
    """Part of a flight program, with its evaluated time interval [s].

    Attributes
    ----------
    name : str
        Name of the part.
    motion : JointMotion
        Motion of the arm.
    begin, end : float
        Evaluated interval [s].
    carries : bool
        Whether the arm picks up a payload at the beginning and releases it at the end.
    """

    name: str
    motion: JointMotion
    begin: float
    end: float
    carries: bool = False


def _grown(name: str, motion: GrownMotion) -> FlightPart:
    return FlightPart(name, motion, motion.ramp, motion.duration - motion.ramp)


def _reach() -> FlightPart:
    out = _moved(HANGING, _STRETCHED, _QUICK), _moved(_STRETCHED, _STRETCHED, _REST)
    back = _moved(_STRETCHED, HANGING, _QUICK), _moved(HANGING, HANGING, 3.0 * _REST)
    motion = MotionSequence([Stage('reach', stage) for stage in (*out, *back)])
    return FlightPart('reach', motion, 0.0, _QUICK + _REST)


def _pick_up() -> FlightPart:
    stages = (
        _moved(HANGING, _STRETCHED, _QUICK),
        _moved(_STRETCHED, _STRETCHED, 3.0 * _REST),
        _moved(_STRETCHED, HANGING, _QUICK),
        _moved(HANGING, HANGING, _REST),
    )
    motion = MotionSequence([Stage('pick-up', stage) for stage in stages])
    return FlightPart('0.2 kg picked up', motion, _QUICK + _REST, motion.duration, carries=True)


def _moved(start: np.ndarray, end: np.ndarray, seconds: float) -> PolynomialPath:
    return PolynomialPath.rest_to_rest(start, end, seconds)


class FlightProgram:
    """Slow and fast motion, a reach of 90 degrees, the excitation, and a payload pick-up.

    The pick-up comes last, because the payload is undeclared and would bias the drone's later
    estimates.

    Parameters
    ----------
    swing : float
        Duration of slow and fast motion and excitation at full amplitude [s].
    parts : sequence of str
        Names in `PARTS` of the parts to fly.

    Attributes
    ----------
    parts : list of FlightPart
        Parts of the program.
    motion : MotionSequence
        Sequence of all parts.
    """

    def __init__(self, swing: float = 2.0, parts: Sequence[str] = PARTS) -> None:
        length = swing + 2.0 * _PART_RAMP
        file = TrajectoryFile.load(resource('config', 'designed_motion.yaml'))
        excitation = file.for_joints(load_arm_config().joint_names)
        all_parts = [
            _grown('slow', ArmSwing('slow', length, _PART_RAMP)),
            _reach(),
            _grown('fast', ArmSwing('fast', length, _PART_RAMP)),
            _grown('excitation', GrownMotion(excitation, length, _PART_RAMP)),
            _pick_up(),
        ]
        self.parts = [part for part in all_parts if part.name in parts]
        self.motion = MotionSequence([Stage(part.name, part.motion) for part in self.parts])

    def without(self, *names: str) -> MotionSequence:
        """Return the motion without given parts."""
        return MotionSequence([x for x in self.motion.stages if x.name not in names])

    @property
    def windows(self) -> dict[str, tuple[float, float]]:
        """Evaluated interval of each part, in the whole motion [s]."""
        starts = self.motion.boundaries[:-1].tolist()
        found = {STILL: (-1.0, 0.0)}
        for start, part in zip(starts, self.parts, strict=True):
            found[part.name] = start + part.begin, start + part.end
        return found

    @property
    def carrying(self) -> tuple[float, ...]:
        """Start and end of carrying a payload [s]; empty without payload."""
        windows = [self.windows[part.name] for part in self.parts if part.carries]
        return windows[0] if windows else ()
