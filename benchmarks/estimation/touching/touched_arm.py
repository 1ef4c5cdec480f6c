"""Emulated arm with contact forces, and the measurements of its encoders and current sensors.

A position controller moves the arm at random. The encoders have 4096 counts per motor turn, the
velocities are low-passed at 100 Hz as on the boards, and the currents are noisy. The contact
detector uses the model that `identify` estimates from a recording of the arm without contact.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from payload_hours import CYCLE, MADE, PURSUIT, Arm, Plant, Work

from aerarm_msgs_py.bags.bag import RecordedMessage, RecordedTopic
from aerarm_msgs_py.bags.bag_writer import BagWriter
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.compensation import FrictionCompensation, MomentumObserver
from aerarm_ros.control.control_loop import ControlLoop, ReferenceSource
from aerarm_ros.control.laws.computed_torque import ComputedTorque
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.identification.identify import IdentificationOptions, Stopwatch, identify
from aerarm_ros.identification.recording.recording import JointMapping, Recording
from aerarm_ros.model.dynamics import Dynamics
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.online.contact_detector import ContactSettings, with_rest_share
from aerarm_ros.online.external_torque import ExternalTorque, ResidualBound, free_rows
from aerarm_ros.online.replay import KnownArm
from aerarm_ros.ros.programs.identifier_bags import IdentifierBags
from aerarm_ros.simulation.arm_plant import SUBSTEP, PlantParameters

Array = np.ndarray

LEARNING = 60.0  # [s] of free motion from which model and thresholds follow
TOOL = (0.1, 0.0, 0.0)  # [m] of tool0 in the frame of the last joint of the packaged arm
_COUNT = 2.0 * np.pi / 4096  # [rad] at the motor
_LOW_PASS = -np.expm1(-2.0 * np.pi * 100.0 * CYCLE)
_OTHER_GEAR = 0.01  # of the arms that have no configuration
_NOISES = 8192


class TouchedPlant(Plant):
    """Simulated arm with a contact force on a link; friction follows the load every 5 ms."""

    def cycle(self, effort: Array) -> None:
        """Advance the simulation by a cycle, with joint torques (n,) [Nm]."""
        self._effort[:] = self._applied[:] = effort
        mujoco.mj_step(self._model, self._data, nstep=round(CYCLE / SUBSTEP))

    def follow_load(self) -> None:
        """Update the dry friction of the joints to the present load."""
        self._set_friction()

    def touch(self, body: int, point: Array, force: Array) -> None:
        """Apply a constant force [N] in world axes at a point in a body's frame [m]."""
        self._data.xfrc_applied[:] = 0.0
        arm = self._data.xpos[body] + self._data.xmat[body].reshape(3, 3) @ point
        moment = np.cross(arm - self._data.xipos[body], force)
        self._data.xfrc_applied[body] = [*force, *moment]

    def torque(self, body: int, point: Array, force: Array) -> Array:
        """Return the joint torques (n,) [Nm] that a force at a point of a body causes."""
        jacobian = np.zeros((3, self.n))
        mujoco.mj_jac(self._model, self._data, jacobian, None, self.place(body, point), body)
        return np.array(jacobian.T @ force)

    @property
    def dry_friction(self) -> Array:
        """Present dry friction of the joints (n,) [Nm]."""
        return np.array(self._friction_limit)

    def place(self, body: int, point: Array) -> Array:
        """Return the world position (3,) [m] of a point of a body."""
        return np.array(self._data.xpos[body] + self._data.xmat[body].reshape(3, 3) @ point)

    @property
    def bodies(self) -> int:
        """Number of bodies, the world included."""
        return int(self._model.nbody)

    def end_of(self, body: int) -> Array:
        """Return the origin of a body's child in the body's frame (3,) [m]; or that of the tool."""
        children = [c for c in range(self._model.nbody) if self._model.body_parentid[c] == body]
        return np.array(self._model.body_pos[children[0]] if children else TOOL)


def controller(
    known: KnownArm,
    references: ReferenceSource,
    friction: FrictionCompensation | None,
    compensated: float,
) -> tuple[ControlLoop, ComputedTorque]:
    """Return the loop of computed torque with an identified model, and its control law.

    The observer compensates disturbances up to a fraction of the largest effort.
    """
    limits = JointLimits.from_config(load_arm_config())
    dynamics = MovingBaseDynamics(known.robot, known.rotor_inertia)
    law = ComputedTorque(dynamics, 400.0, 40.0, None, friction, 1.5 * CYCLE, 1.59e-3)
    observer = MomentumObserver(dynamics, np.full(4, 30.0), friction)
    most = compensated * limits.effort_max
    return ControlLoop(limits, references, law, observer, None, most), law


class Sensors:
    """Encoders and current sensors of the boards, once per cycle."""

    def __init__(self, arm: Arm, position: Array, random: np.random.Generator) -> None:
        n = arm.robot.n
        gear = load_arm_config().column('gear.ratio') if n == 4 else np.full(n, _OTHER_GEAR)
        self._count = _COUNT * gear
        self._noise = arm.noise * random.standard_normal((_NOISES, n))
        self._cycle = 0
        self.q = self._counted(position)
        self.dq = np.zeros(n)

    def measure(self, position: Array, effort: Array) -> ArmState:
        """Return the measured state at the end of a cycle with joint torques `effort` [Nm]."""
        q = self._counted(position)
        self.dq = self.dq + _LOW_PASS * ((q - self.q) / CYCLE - self.dq)
        self.q = q
        self._cycle += 1
        return ArmState(q, self.dq, effort + self._noise[self._cycle % _NOISES])

    def _counted(self, position: Array) -> Array:
        return np.floor(position / self._count) * self._count


class TouchedArm:
    """Emulated arm that moves under position control with feed-forward.

    Parameters
    ----------
    arm : Arm
    truth : PlantParameters
        What it is made of.
    seed : int
        Of its motion.
    """

    def __init__(self, arm: Arm, truth: PlantParameters, seed: int) -> None:
        random = np.random.default_rng(seed)
        work = Work(arm.robot, random)
        self.plant = TouchedPlant(arm.robot, truth, work.start)
        self._sensors = Sensors(arm, work.start, random)
        self._moves, self._truth = work.play(), truth
        robot = arm.robot.with_inertial_parameters(truth.inertial_parameters)
        self._model = Dynamics(robot, truth.rotor_inertia)
        self._stiffness = PURSUIT**2 * np.diag(self._model.inertia_matrix(work.start))
        self._damping = 2.0 * self._stiffness / PURSUIT

    def cycles(self, count: int) -> Iterator[ArmState]:
        """Advance by some cycles with constant feed-forward, and yield the measured states."""
        self.plant.follow_load()
        moves = [next(self._moves) for _ in range(count)]
        q, dq, ddq = moves[count // 2]
        friction = self._truth.viscous * dq + self._truth.coulomb * np.tanh(dq / 0.02)
        ahead = self._model.inverse(q, dq, ddq) + friction
        sensors = self._sensors
        for q, dq, _ in moves:
            tau = ahead + self._stiffness * (q - sensors.q) + self._damping * (dq - sensors.dq)
            self.plant.cycle(tau)
            yield sensors.measure(self.plant._angle, tau)

    def record(self, seconds: float) -> Array:
        """Return the states (k, 3, n) of a motion without contact."""
        count = 5
        return np.array(
            [state for _ in range(round(seconds / CYCLE / count)) for state in self.cycles(count)]
        )


@dataclass(frozen=True, eq=False)
class Learnt:
    """Model, thresholds and settings of the contact detector for one emulated arm."""

    model: KnownArm
    bound: ResidualBound
    settings: ContactSettings

    def external(self) -> ExternalTorque:
        """Return a new observer of the external torque."""
        return ExternalTorque(self.model, self.bound.gain)


def made(joints: int, seed: int) -> tuple[Arm, PlantParameters]:
    """Return an arm, and the true parameters of the emulated arm with a seed."""
    arm = Arm.of(joints)
    return arm, arm.drawn.perturbed(seed, MADE)


def identified(arm: Arm, truth: PlantParameters, seed: int) -> tuple[KnownArm, Recording]:
    """Record a motion without contact and identify the arm; return model and recording."""
    recording = _through_bag(arm, TouchedArm(arm, truth, seed).record(LEARNING))
    config = load_arm_config() if arm.robot.n == 4 else None
    options = IdentificationOptions()
    result = identify(arm.robot, config, [recording], [], options, Stopwatch())
    return KnownArm.identified(arm.robot, result.recommended.estimate), recording


def learn(arm: Arm, truth: PlantParameters, seed: int, gain: float) -> Learnt:
    """Identify the arm and learn thresholds, both from the same recording."""
    model, recording = identified(arm, truth, seed)
    settings = ContactSettings(0.01, payload_mass=arm.mass, payload_size=0.15)
    bound = ResidualBound.learnt(
        free_rows(ExternalTorque(model, gain), recording, lambda: False), gain
    )
    columns = (recording.q, recording.dq, recording.tau)
    rows = zip(recording.time.tolist(), *columns, strict=True)
    states = [(time, ArmState(*row)) for time, *row in rows]
    bound = with_rest_share(bound, lambda: ExternalTorque(model, gain), lambda: states, settings)
    return Learnt(model, bound, settings)


def _through_bag(arm: Arm, rows: Array) -> Recording:
    """Write states to a bag and read it as the identifier does."""
    names, topic = arm.robot.joint_names, '/joint_states'
    codec = JointStateCdr(names)
    with TemporaryDirectory() as folder:
        path = Path(folder, 'free')
        kind = 'sensor_msgs/msg/JointState'
        with BagWriter(path, [RecordedTopic(topic, kind)]) as writer:
            for number, row in enumerate(rows):
                stamp = 10**18 + round(1e9 * CYCLE) * number
                writer.write(RecordedMessage(0, codec.pack(stamp, *row), stamp, stamp, number + 1))
        return IdentifierBags(topic, names, JointMapping({})).read(path, 'free').recording
