"""A drone that PX4's firmware flies (SITL), led by set points with what the arm's motion takes."""

import time
from enum import Enum

import numpy as np

from aerarm_ros.autopilot.mavlink import Message
from aerarm_ros.autopilot.px4 import ned
from aerarm_ros.autopilot.px4_link import Companion, Controls, Simulator, companion_writer
from aerarm_ros.autopilot.px4_sensors import SensorFrames
from aerarm_ros.autopilot.px4_set_points import Px4SetPoints
from aerarm_ros.autopilot.px4_setup import GPS, Px4Setup
from aerarm_ros.description.drone_config import GRAVITY, DroneConfig
from aerarm_ros.flight.arm_load import FeedForward, MassProperties
from aerarm_ros.flight.flight_control import FlightGains
from aerarm_ros.flight.flight_state import FlightState, FlightTarget
from aerarm_ros.motion.signals import Array

STEP_US = 4000
"""Between two samples of the sensors while PX4 gets ready [us]."""

_UP = np.array([0.0, 0.0, 1.0])
_BOOT, _ANSWER = 0.02, 2.0  # [s] of this host: before PX4 has ever answered, and since
_LISTEN = 0.05  # [s]
_SETTLED = 2.0  # [s] of PX4's time with a position, before it is armed
_ASK_EVERY = 0.5  # [s] of PX4's time, between two requests to arm
# While it is held its set point is that far above it [m], as PX4 takes off for nothing less. PX4
# takes the lift of a drone that does not rise for its hover thrust, so the lift must exceed the
# weight soon. Then the set point comes down in that time [s], as a step would be a fall.
_ABOVE, _LOWERING = 0.3, 2.0
_HEARTBEAT = 0.5  # [s]
_ARM, _SET_MODE = 400, 176  # MAV_CMD_COMPONENT_ARM_DISARM, MAV_CMD_DO_SET_MODE
_CUSTOM_MODE, _OFFBOARD, _ARMED = 1, 6, 128
_COMPANION = {'type': 18, 'autopilot': 8, 'system_status': 4, 'mavlink_version': 3}
_TEXTS = 50  # of PX4's that are kept


class Stage(Enum):
    """How far PX4 is on its way into the air."""

    BOOT = 'no answer from PX4 yet: start PX4 before this node, with the same px4_instance'
    SETTLE = "PX4's estimator is settling"
    ARM = 'PX4 is arming'
    SPOOL = "PX4's rotors are spooling up"
    FLY = ''


class Px4Firmware:
    """A PX4 in lock-step: it is led into the air while the drone is held, then step by step.

    PX4's time is that of the sensors and goes on while the drone is held, however long the world
    stands still: its estimator needs seconds to settle and its rotors to spool up.

    Parameters
    ----------
    simulator, companion
        The lines to it.
    setup : Px4Setup
        As it was set up.
    seed : int
        Of the sensors' noise.

    Attributes
    ----------
    stage : Stage
    texts : list of str
        What it reported, the newest last: rejected set points are among it.
    origin : (3,) ndarray
        Where its local frame begins in the world, north-east-down [m].
    """

    def __init__(
        self, simulator: Simulator, companion: Companion, setup: Px4Setup, seed: int = 0
    ) -> None:
        self._simulator, self._companion = simulator, companion
        self._writer = companion_writer()
        self._frames = SensorFrames(companion_writer(), setup.sensors, seed)
        self._time_us = STEP_US
        self._asked_us = self._beat_us = self._sent = 0
        self._is_heard = False
        self._is_gps = setup.sensors == GPS
        self._offsets: list[Array] = []
        self._placed_us: int | None = None
        self._controls: Controls | None = None
        self._place: Array | None = None
        self._mode = 0
        self.stage = Stage.BOOT
        self.texts: list[str] = []
        self.origin = np.zeros(3)

    @property
    def problem(self) -> str:
        """Why it does not fly, '' if it does."""
        if self._simulator.is_lost:
            return 'PX4 has ended or closed the connection: restart PX4 and this node'
        if self.stage is Stage.FLY:
            return self._loss()
        texts = [text for text in self.texts[-3:] if 'Arming denied' in text or 'Preflight' in text]
        return '; '.join([self.stage.value, *texts])

    @property
    def is_led(self) -> bool:
        """Whether it follows set points; where they stop, its failsafe acts after COM_OF_LOSS_T."""
        return self._mode >> 24 == _OFFBOARD

    @property
    def time_ms(self) -> int:
        """PX4's time [ms]."""
        return self._time_us // 1000

    def send(self, name: str, **values: object) -> None:
        """Send a message to it."""
        self._companion.send(self._writer.pack(name, **values))

    def step(self, state: FlightState, dt: float, is_placed: bool = True) -> Array | None:
        """Advance by `dt` [s] to a state; return the shares (16,) of thrust, None without any."""
        return self._step(state, round(1e6 * dt), is_placed, is_held=False)

    def hold(self, state: FlightState, lift: float) -> Array | None:
        """Advance by a step of a drone that is held; return the shares, as `step` does.

        `lift` is the sum of shares that carries the drone.
        """
        shares = self._step(state, STEP_US, is_placed=True, is_held=True)
        place = ned(state.position)
        if self.stage is Stage.BOOT and self._controls is not None:
            self.stage = Stage.SETTLE
        elif self.stage is Stage.SETTLE:
            self._settle(place)
        elif self.stage is Stage.ARM:
            self._ask()
        elif self.stage is Stage.SPOOL and self._controls is not None:
            if not self._controls.is_armed:
                self.stage = Stage.ARM
            elif float(self._controls.shares.sum()) > lift:
                self.stage = Stage.FLY
        return shares

    def _step(
        self, state: FlightState, step_us: int, is_placed: bool, is_held: bool
    ) -> Array | None:
        self._beat()
        self._await_taken()
        self._time_us += max(step_us, 1)
        frames = self._frames.frames(self._time_us, state, is_placed, is_held)
        patience = _BOOT if self._controls is None else _ANSWER
        answer = self._simulator.step(self._time_us, frames, patience)
        for message in self._companion.messages():
            self._take(message)
        if answer is None:
            return None
        self._controls = answer
        return answer.shares

    def _await_taken(self) -> None:
        """Wait until PX4 has taken what was sent, which it answers in the order of its coming.

        Its receiver does not take part in the lock-step: on a busy host it would be late.
        """
        if not self._is_heard:
            return
        self._sent += 1
        self.send('TIMESYNC', ts1=self._sent)
        deadline, is_taken = time.monotonic() + _ANSWER, False
        while not is_taken and time.monotonic() < deadline and not self._simulator.is_lost:
            for message in self._companion.messages(_LISTEN):
                is_taken |= message.name == 'TIMESYNC' and message['ts1'] == self._sent
                self._take(message)

    def _settle(self, place: Array) -> None:
        if self._place is None:
            return
        if self._placed_us is None:
            self._placed_us = self._time_us
        self._offsets.append(self._place - place)
        if self._time_us - self._placed_us > 1e6 * _SETTLED:
            if self._is_gps:  # else its frame is that of the odometry
                self.origin = np.mean(self._offsets[len(self._offsets) // 2 :], axis=0)
            self.stage = Stage.ARM

    def _ask(self) -> None:
        """Ask for offboard mode and then for arming, again and again."""
        if self._mode & _ARMED and self.is_led:
            self.stage = Stage.SPOOL
            return
        if self._time_us - self._asked_us < 1e6 * _ASK_EVERY:
            return
        self._asked_us = self._time_us
        if not self.is_led:
            self._command(_SET_MODE, _CUSTOM_MODE, _OFFBOARD)
        else:
            self._command(_ARM, 1.0)

    def _command(self, command: int, *parameters: float) -> None:
        values = {f'param{i}': value for i, value in enumerate(parameters, 1)}
        self.send('COMMAND_LONG', target_system=0, target_component=1, command=command, **values)

    def _beat(self) -> None:
        if self._time_us - self._beat_us > 1e6 * _HEARTBEAT:
            self._beat_us = self._time_us
            self.send('HEARTBEAT', **_COMPANION)

    def _take(self, message: Message) -> None:
        self._is_heard = True
        if message.name == 'HEARTBEAT' and message.component == 1:
            # Main mode in bits 16 to 23 of the custom mode, above the flags of the base mode.
            self._mode = (message['custom_mode'] >> 16 & 0xFF) << 24 | message['base_mode']
        elif message.name == 'LOCAL_POSITION_NED':
            self._place = np.array([message['x'], message['y'], message['z']])
        elif message.name == 'STATUSTEXT':
            self.texts = [*self.texts[1 - _TEXTS :], message['text']]

    def _loss(self) -> str:
        if self._controls is not None and not self._controls.is_armed:
            return 'PX4 has disarmed: ' + '; '.join(self.texts[-2:])
        return ''


class Px4FirmwareFlight:
    """Set points for a PX4 of this host, used as a `FlightControl`.

    Parameters
    ----------
    drone : DroneConfig
    body : MassProperties
        Of drone and arm at rest.
    firmware : Px4Firmware
    setup : Px4Setup
        As the firmware was set up.
    gains : FlightGains
        Of the position loop on this side, for a drone that pushes sideways.
    tilts_ahead : bool
        Whether set points tilt ahead, by the inverse of PX4's loops.
    holds_heading : bool
        Whether set points have a heading; else it is left to itself.

    Attributes
    ----------
    problem : str
        Why the rotors are not commanded, '' if they are.
    is_settling : bool
        Whether `settle` leads PX4 on its way into the air.
    """

    def __init__(
        self,
        drone: DroneConfig,
        body: MassProperties,
        firmware: Px4Firmware,
        setup: Px4Setup,
        gains: FlightGains | None = None,
        tilts_ahead: bool = True,
        holds_heading: bool = True,
    ) -> None:
        self._firmware = firmware
        self._thrust_max = drone.column('thrust_max')
        self._at_rest = FeedForward.at_rest(body)
        self._lift = body.mass * GRAVITY / float(np.mean(self._thrust_max * drone.allocation[2]))
        self._above = _ABOVE
        self._held: FlightState | None = None
        tilt = setup.gains if tilts_ahead else None
        self._set_points = Px4SetPoints(drone, gains, tilt, holds_heading)
        self._shares = np.zeros(drone.n)

    @property
    def problem(self) -> str:
        """Why the rotors are not commanded, '' if they are."""
        return self._firmware.problem

    @property
    def is_settling(self) -> bool:
        """Whether `settle` leads PX4 on its way into the air."""
        return self._held is not None and self._firmware.stage is not Stage.FLY

    def reset(self) -> None:
        """Forget the integral."""
        self._set_points.reset()

    def settle(self) -> None:
        """Let PX4's time go on while the drone is held where it was last seen."""
        if self._held is None:
            return
        if self._firmware.stage in (Stage.ARM, Stage.SPOOL):
            self._lead(self._held, FlightTarget.here(self._held), 0.0, self._at_rest)
        self._note(self._firmware.hold(self._held, self._lift))

    def update(
        self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward | None = None
    ) -> Array:
        """Return the thrusts (n,) [N] that PX4 commands, after a step of `dt` [s]."""
        if self._firmware.stage is not Stage.FLY:
            self._held = state
            self.settle()
            return self._thrusts()
        if dt > 0.0:  # else this state is the one in which it was led into the air
            self._lead(state, target, dt, self._at_rest if arm is None else arm)
            self._note(self._firmware.step(state, dt))
        return self._thrusts()

    def level(self, state: FlightState, dt: float) -> Array:
        """Return the thrusts (n,) [N] of a PX4 that lost its odometry: its failsafe acts."""
        self._note(self._firmware.step(state, dt, is_placed=False))
        return self._thrusts()

    def _note(self, shares: Array | None) -> None:
        if shares is not None:
            self._shares = np.clip(shares[: len(self._thrust_max)], 0.0, 1.0)

    def _thrusts(self) -> Array:
        return np.asarray(self._shares * self._thrust_max)

    def _lead(self, state: FlightState, target: FlightTarget, dt: float, arm: FeedForward) -> None:
        self._above *= float(np.exp(-dt / _LOWERING))
        above = target._replace(position=target.position + self._above * _UP)
        name, values = self._set_points.message(state, above, dt, arm, self._firmware.origin)
        self._firmware.send(name, time_boot_ms=self._firmware.time_ms, **values)
