"""What the boards report, as arrays over the joints."""

from collections.abc import Sequence

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.hardware.boards.board_link import BoardLink
from aerarm_ros.hardware.frames.frame_profile import FrameProfile
from aerarm_ros.hardware.gate.command_intake import Mask
from aerarm_ros.model.drive_train import DriveTrain
from aerarm_ros.motion.signals import Array


class MotorPower:
    """Input power of each motor, thesis (4.1) with i_d = 0, and its integral.

    If the boards report the quadrature voltage, ``P = 3/2 u_q i_q``. Else it is the sum of
    the parts of thesis section 4.1 for constant current, Joule loss and mechanical power,
    ``P = 3/2 R i_q^2 + K_i i_q omega_m``, with the configuration's R and K_i.

    Parameters
    ----------
    config
        Resistances and torque constants.
    profile
        Tells what the boards report.

    Attributes
    ----------
    source
        'voltage' (reported) or 'model' (computed).
    watts, energy
        (n,) [W], and [J] since start; updated in place.
    """

    def __init__(self, config: ArmConfig, profile: FrameProfile) -> None:
        self.source = 'voltage' if profile.sensor.has('quadrature_voltage') else 'model'
        self.watts = np.zeros(config.n)
        self.energy = np.zeros(config.n)
        self._is_known = False  # the boards' last good state stays, so it is known for good
        self._resistance = 1.5 * config.column('motor.resistance')
        self._torque_constant = config.column('motor.torque_constant')

    def update(self, current: Array, velocity: Array, voltage: Array, dt: float) -> None:
        """Take (n,) motor currents [A], speeds [rad/s] and voltages [V], dt [s] after the last.

        While some are NaN, before the boards have answered, power and energy stay zero.
        """
        if not self._is_known:
            if np.isnan(current).any():
                return
            self._is_known = True
        if self.source == 'voltage':
            self.watts[:] = 1.5 * voltage * current
        else:
            voltage_like = self._resistance * current + self._torque_constant * velocity
            np.multiply(voltage_like, current, out=self.watts)
        self.energy += self.watts * dt


def resistance_by_boards(links: Sequence[BoardLink], n: int) -> Array:
    """Return the phase resistance of each of n motors as their boards report it, (n,) [ohm].

    NaN where frames carry none, and where a board reports zero, which stands for unknown.
    """
    resistance = np.full(n, np.nan)
    for link in links:
        for joint, channel in link.joints:
            resistance[joint] = link.state.coil_resistance[channel] or np.nan
    return resistance


# Times over which references are held that the correction of the torque is good for [s].
_HOLD_MIN, _HOLD_MAX = 1e-5, 5e-3

Gains = Sequence[tuple[float, float]]


class ArmMeasurements:
    """Measurements of n joints and their motors; the last good ones of each board.

    Attributes
    ----------
    q, dq, tau
        (n,) joint positions [rad], velocities [rad/s], torques [Nm] as the mean of the last
        cycle; NaN until the first good frame.
    motor_position, motor_velocity, motor_current, motor_voltage
        (n,) motor side [rad], [rad/s], [A], [V]. Positions count from the motors' zeros.
    reported_position
        (n,) motor positions as the boards count them [rad].
    index_toggle
        (n,) bits that flip at an encoder's index pulse.
    fresh
        (n,) whether the motor's board answered in the last cycle.
    heard
        (n,) False once a board has been silent for so long that it counts as not heard.
    driven
        (n,) whether the motor's board drove its motors, aligned, when it last answered.
    unconfirmed
        n numbers of commands sent since the one that the motor's board used when it answered last;
        0 while the board loses none.
    interval, interval_max
        (n,) time between the two last measurements of each motor, and the longest that it can
        have been [s]; see `BoardLink`.
    """

    def __init__(self, config: ArmConfig) -> None:
        def unknown() -> Array:
            return np.full(config.n, np.nan)

        self.q, self.dq, self.tau = unknown(), unknown(), unknown()
        self.motor_position, self.motor_velocity = unknown(), unknown()
        self.motor_current, self.motor_voltage = unknown(), unknown()
        self.reported_position = unknown()
        self.index_toggle: Mask = np.zeros(config.n, dtype=bool)
        self.fresh: Mask = np.zeros(config.n, dtype=bool)
        self.heard: Mask = np.zeros(config.n, dtype=bool)
        self.driven: Mask = np.zeros(config.n, dtype=bool)
        self.unconfirmed = [0] * config.n
        self.interval, self.interval_max = unknown(), unknown()
        self._measured_at: Array = np.full(config.n, -np.inf)  # begin of that cycle [s]
        self._drive = DriveTrain(config)
        self._last_velocity = unknown()
        self._believed = unknown()

    def believed(self, tells: Mask) -> tuple[Array, Array]:
        """Return positions [rad] and velocities [rad/s] for what needs the whole arm, (n,) each.

        A joint whose encoder does not tell its position, of (n,) `tells`, stands where it was last
        believed to be: its numbers would make nonsense of what the other joints carry.
        """
        if tells.all():
            self._believed[:] = self.q
            return self.q, self.dq
        self._believed[tells] = self.q[tells]
        return self._believed, np.where(tells, self.dq, 0.0)

    def read(
        self,
        links: Sequence[BoardLink],
        zero: Array,
        gains: Gains,
        lag: float | None = None,
    ) -> None:
        """Take the boards' last states.

        A board holds its references for a cycle while the motor turns on, so its current
        falls by Kp times the angle and Kd times the change of velocity (4.4), and the frame
        samples it at the end of the hold. Without a correction every moving joint seems to
        have negative viscous friction, and too little inertia.

        Parameters
        ----------
        links
            The boards.
        zero
            (n,) reported angles of motor zero [rad].
        gains
            Kp and Kd of each board's motors, n pairs, motor side [A/rad], [A s/rad].
        lag
            Time constant of the boards' current loop [s]; None for a second look at the same
            states.
        """
        self._last_velocity[:] = self.motor_velocity
        for link in links:
            state, echo = link.state, link.monitor.echo
            unconfirmed = echo.unconfirmed if echo.is_losing else 0
            for joint, channel in link.joints:
                self.fresh[joint] = link.fresh
                self.heard[joint] = not link.monitor.is_silent
                self.driven[joint] = link.is_aligned
                self.unconfirmed[joint] = unconfirmed
                if link.fresh:
                    self.reported_position[joint] = state.position[channel]
                    self.motor_velocity[joint] = state.velocity[channel]
                    self.motor_current[joint] = state.current[channel]
                    self.motor_voltage[joint] = state.quadrature_voltage[channel]
                    self.index_toggle[joint] = state.index_toggle[channel]
                    self.interval[joint] = link.interval
                    self.interval_max[joint] = link.interval_max
        np.subtract(self.reported_position, zero, out=self.motor_position)
        self.q[:] = self._drive.motor_to_joint_position(self.motor_position)
        self.dq[:] = self._drive.motor_to_joint_velocity(self.motor_velocity)
        self.tau[:] = self._drive.current_to_effort(self.motor_current + self._droop(gains, lag))

    def age(self, now: float, last: float) -> tuple[Array, Array]:
        """Return how old the measurements are, and the time between the two last, (n,) each [s].

        To be called once a cycle: `now` is when it began [s], `last` when the one began whose
        exchange `read` has seen. The time between is 0 where there is none newer than at the
        last call, and inf where there was none before.
        """
        between: Array = np.where(self.fresh, last - self._measured_at, 0.0)
        self._measured_at[self.fresh] = last
        return np.maximum(now - self._measured_at, 0.0), between  # a clock may go back

    def _droop(self, gains: Gains, lag: float | None) -> list[float]:
        """Return by how much the sampled currents lie below the cycle's mean [A].

        Plain numbers, not arrays: for four joints that is faster.
        """
        if lag is None:
            return [0.0] * len(gains)
        velocities, before = self.motor_velocity.tolist(), self._last_velocity.tolist()
        droop = []
        for (kp, kd), velocity, last, interval in zip(
            gains, velocities, before, self.interval.tolist(), strict=True
        ):
            # In the middle of the hold the current equals its mean; the current loop's lag has
            # already made up for a part of the way from there to the sample.
            hold = min(max(interval, _HOLD_MIN), _HOLD_MAX)
            share = max(0.5 * hold - lag, 0.0)
            change = velocity - last if last == last else 0.0  # of a first frame
            droop.append(share * (kp * velocity + kd / hold * change))
        return droop
