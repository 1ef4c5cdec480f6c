"""Where one joint may still go: the speed from which it can be braked, and the torque for it."""

from math import exp, nan, sqrt

import numpy as np

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.drive_config import JointConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.model.dynamics import Dynamics, largest_gravity_load
from aerarm_ros.model.inertia import point_mass
from aerarm_ros.motion.signals import Array

_POSTURES = 500
# Of the torque beyond the largest load, this share is relied on for braking: the arm that was
# built is not the one that was drawn, and other joints' motion pulls at it. Joint 1 at full speed
# throws the arm outward with 4 Nm where joint 2 has passed 45 degrees.
_RELIABLE_SHARE = 0.5

# A damped arm falls at this share of the velocity limits at most, and is slowed to it within a time
# [s] that is short beside the fall from upright to a limit.
_FALLING_SHARE = 0.4
_DAMPING_TIME = 0.2


class JointLoads:
    """Loads and inertias of n joints, with half the rated payload: the error is then the smallest.

    Parameters
    ----------
    config
        Drives, limits and the rated payload.
    robot
        The arm as drawn.

    Attributes
    ----------
    load_max
        (n,) largest torque of gravity with the rated payload, however the base turns [Nm].
    inertia_max
        (n,) largest inertia with the rated payload [kg m^2].
    deceleration
        (n,) that can be relied on with any payload up to the rated one [rad/s^2]: the
        configuration's acceleration limit, or what the drive's torque leaves beyond the load.

    damping_min
        (n,) damping with which a stretched-out arm that is let go, the rated payload in its hand,
        falls at 0.4 of the velocity limit at most and comes to its speed in 0.2 s [Nms/rad].

    Raises
    ------
    ValueError
        If configuration and robot are not of one arm, or a drive cannot hold the arm.
    """

    def __init__(self, config: ArmConfig, robot: Robot) -> None:
        if config.joint_names != robot.joint_names:
            raise ValueError(
                f'the configuration has joints {config.joint_names}, but the URDF has '
                f'{robot.joint_names}: pass files of the same arm'
            )
        inertia = config.column('reflected_inertia')
        mass, *centre = config.rated_payload
        payload = point_mass(mass, centre)
        self._dynamics = Dynamics(robot, inertia)
        self._dynamics.carry(0.5 * payload)
        loaded = np.array(robot.inertial_parameters)
        loaded[-1] += payload
        whole = robot.with_inertial_parameters(loaded)
        self.load_max = largest_gravity_load(whole)
        self.inertia_max = _largest_inertia(whole, inertia)
        effort_max = config.column('effort_max')
        self._velocity_max = config.column('velocity_max')
        for joint, load in zip(config.joints, self.load_max.tolist(), strict=True):
            if joint.effort_max <= load:
                raise ValueError(
                    f'joint {joint.name}: effort_max = {joint.effort_max:g} Nm cannot carry the '
                    f'outstretched arm with its rated payload, which needs {load:.2f} Nm; check '
                    'effort_max, rated_payload and the URDF'
                )
        spare = _RELIABLE_SHARE * (effort_max - self.load_max) / self.inertia_max
        self.deceleration: Array = np.minimum(config.column('acceleration_max'), spare)

    @property
    def damping_min(self) -> Array:
        """Least damping of each joint (n,) [Nms/rad]; see the class."""
        falling = self.load_max / (_FALLING_SHARE * self._velocity_max)
        least: Array = np.maximum(falling, self.inertia_max / _DAMPING_TIME)
        return least

    def at(self, q: Array, dq: Array, effort: Array) -> tuple[list[float], list[float]]:
        """Return loads [Nm] and inertias [kg m^2], one per joint.

        The load is what the arm's weight, its speed and the acceleration of the other joints
        take of the torque.

        Parameters
        ----------
        q, dq, effort
            (n,) positions [rad], velocities [rad/s] and the torques that act [Nm].
        """
        acceleration = self._dynamics.forward(q, dq, effort)
        inertias = self._dynamics.inertia_matrix(q).diagonal()
        return (effort - inertias * acceleration).tolist(), inertias.tolist()


def _largest_inertia(robot: Robot, rotor_inertia: Array) -> Array:
    dynamics = Dynamics(robot, rotor_inertia)
    random = np.random.default_rng(0)
    postures = random.uniform(*robot.posture_range, (_POSTURES, robot.n))
    inertias = [dynamics.inertia_matrix(q).diagonal() for q in postures]
    largest: Array = np.max(inertias, axis=0)
    return largest


# The speed that the barrier keeps lies this much over the limit, which commands may reach.
_SPEED_SHARE = 1.05
# Torque per speed beyond the barrier: full torque from this share of the speed limit on, ...
_FULL_TORQUE_SHARE = 0.1
# ... but no faster [1/s] than a torque that acts up to 2 ms later, and quantised speeds, allow.
_FASTEST = 250.0
# The approach to a limit is this much slower than what holds the joint to it.
_APPROACH_SHARE = 0.25
# What the arm carries beyond what is known of it is found from how it moves: with this time
# constant [s], up to this share of the largest torque, ...
_DISTURBANCE_TIME = 5e-3
_DISTURBANCE_SHARE = 0.15
# ... and of what is beyond that a part at a time, while the joint is faster than this share of its
# limit, to which it would add. A base turned over, which nobody tells the bridge, takes twice the
# arm's weight from a joint. At a slow joint counts of the encoder look like that: it fades [s].
_TURNED_PART = 0.2
_TURNED_SHARE = 2.0  # of the largest torque, which holds the weight
_TURNED_SPEED_SHARE = 0.5
_TURNED_FADING = 0.03
# Between two measurements further apart [s] the torque was another one than is known.
_APART = 5e-3
_SPEED_NOISE = 0.15  # [rad/s] of a speed made of counts, without its low-pass
# A joint that gives way to another one is slowed from its speed limit to a share of it, where what
# its motion pulls at others is a tenth, in a time [s], and may be fast again after another [s].
_GIVE_WAY_SHARE = 0.3
_GIVE_WAY_TIME = 0.3
_RECOVERY_TIME = 1.0
# A host that is held up leaves its last torque acting, until the board's time-out. What would bring
# the joint beyond this share of its speed limit by then is given with a damping, in the board, that
# ends it there; with no more [1/s] than the low-pass of the speed that it damps by allows.
_GAP_SHARE = 1.1
# Other joints, which a later command may brake with their whole torque while this one goes on, pull
# at it by up to this share of its torque; then it ends a twentieth of the limit faster.
_GAP_PULL_SHARE = 0.05
_GAP_FASTEST = 700.0
_GAP_ROOM_SHARE = 0.05  # of the speed limit, for a joint that is as fast already
# A joint beyond its limit is led back at no more than this share of the speed limit.
_RETURN_SHARE = 0.05
# An arm whose weight is more than a warm motor's reduced torque sinks at this share of it at most.
_SINKING_SHARE = 0.1


class JointBarrier:
    """Torques that keep a joint within its limits of position and speed, for one cycle.

    The barrier is a speed that falls with the distance left to a limit, to what `deceleration`
    can brake. Of the commands, those that the joint can be braked after pass; the torque of the
    others is cut to `highest` (or raised to `lowest`), which near the barrier is the torque that
    brakes along it, and beyond it leads back. Both are for a state predicted to when the torque
    will act: the boards low-pass the speed, and it is a cycle old.

    Plain numbers, not arrays: for four joints that is faster.

    Parameters
    ----------
    joint
        Limits.
    settings
        `period`, `soft_zone`, `velocity_lag` and `board_timeout` are used here.
    deceleration
        That the joint can be relied on for, with any load [rad/s^2].
    inertia_max
        Largest inertia [kg m^2].

    Attributes
    ----------
    far
        Distance from a limit [rad] from which on it slows nothing.
    q, dq, filtered
        Predicted position [rad], speed, and what the board will make of it [rad/s].
    inertia
        What the joint moves [kg m^2].
    load
        What the arm's weight and motion take of the torque, the unknown part included [Nm].
    is_overwhelmed
        Whether the drive's whole torque does not brake it as the barrier asks: what other joints'
        motion pulls at it is too much.
    noise
        Torque that the last count of an encoder may make of the bounds [Nm].
    lowest, highest
        Torque bounds for the coming cycle [Nm], unlimited in size: where they are beyond what
        the drive gives, the board saturates.
    lets_down
        Whether the joint's position limits no longer hold, because its motor is too warm to hold it
        there. It goes on beyond them slowly, until its stop or its weight ends that.
    """

    __slots__ = (
        '_acceleration',
        '_allowed',
        '_approach',
        '_corner',
        '_cycle',
        '_deceleration',
        '_disturbance',
        '_disturbance_max',
        '_effort_max',
        '_fastest',
        '_gain_max',
        '_gap_pull',
        '_gap_room_min',
        '_gap_speed',
        '_gap_time',
        '_is_known',
        '_kept',
        '_kept_acceleration',
        '_kept_time',
        '_lag',
        '_last_speed',
        '_modelled_load',
        '_position_max',
        '_position_min',
        '_return',
        '_speed',
        '_turned',
        '_turned_max',
        '_unhindered',
        'dq',
        'far',
        'filtered',
        'highest',
        'inertia',
        'is_overwhelmed',
        'lets_down',
        'load',
        'lowest',
        'noise',
        'q',
    )

    def __init__(
        self,
        joint: JointConfig,
        settings: BridgeSettings,
        deceleration: float,
        inertia_max: float,
    ) -> None:
        self._position_min, self._position_max = joint.position_min, joint.position_max
        self._effort_max = joint.effort_max
        self._unhindered = self._fastest = _SPEED_SHARE * joint.velocity_max
        self._return = _RETURN_SHARE * joint.velocity_max
        self._lag = settings.velocity_lag
        self._cycle = settings.period
        self._disturbance_max = _DISTURBANCE_SHARE * joint.effort_max
        self._turned_max = _TURNED_SHARE * joint.effort_max
        self._gap_time = settings.board_timeout
        self._gap_speed = _GAP_SHARE * joint.velocity_max
        self._gap_room_min = _GAP_ROOM_SHARE * joint.velocity_max
        self._gap_pull = _GAP_PULL_SHARE * joint.effort_max
        self.inertia = inertia_max
        self._gain_max = joint.effort_max / (_FULL_TORQUE_SHARE * joint.velocity_max)
        slowest = min(_FASTEST, self._gain_max / inertia_max)
        self._approach = min(joint.velocity_max / settings.soft_zone, _APPROACH_SHARE * slowest)
        self._deceleration = deceleration
        self._corner = deceleration / self._approach**2
        self.far = self._fastest / self._approach
        if self.far > self._corner:
            self.far = self._fastest**2 / (2.0 * deceleration) + 0.5 * self._corner
        self._kept, self._kept_time = 1.0, 0.0
        self._acceleration, self._kept_acceleration = 0.0, nan
        self._allowed = self._unhindered
        self.is_overwhelmed = self.lets_down = False
        self.q = self.dq = self.filtered = self.load = self.noise = self.lowest = self.highest = 0.0
        self._modelled_load = 0.0
        self.restart()

    def restart(self) -> None:
        """Reset the motion estimate; the measured speed is used."""
        self._is_known = False  # how fast it was, and what pulled at it
        self._fastest = self._unhindered
        self._disturbance = self._turned = 0.0

    @property
    def is_slowed(self) -> bool:
        """Whether the joint may not use its whole speed, for another one's or its motor's sake."""
        return self._fastest < self._unhindered or self._allowed < self._unhindered

    def give_way(self, interval: float) -> None:
        """Lower the speed of the joint, whose motion is too much for another, for a time [s]."""
        least = _GIVE_WAY_SHARE * self._unhindered
        self._fastest = max(self._fastest - self._unhindered * interval / _GIVE_WAY_TIME, least)

    def recover(self, interval: float) -> None:
        """Let the joint become as fast as it may be, over a time [s]."""
        if self._fastest > self._allowed:
            less = self._fastest - self._unhindered * interval / _GIVE_WAY_TIME
            self._fastest = max(less, self._allowed)
            return
        more = self._fastest + self._unhindered * interval / _RECOVERY_TIME
        self._fastest = min(more, self._allowed)

    def hold_back(self, sinks: bool) -> None:
        """Allow the joint a small share of its speed while its load is more than its torque."""
        self._allowed = (_SINKING_SHARE if sinks else 1.0) * self._unhindered

    def speed(self, distance: float) -> float:
        """Return the speed [rad/s] from which the joint stops within a distance [rad]."""
        if self.lets_down:
            return min(self._return, self._fastest)
        if distance >= self.far:
            return self._fastest
        if distance < self._corner:
            return max(self._approach * distance, -self._return)
        reachable = sqrt(2.0 * self._deceleration * (distance - 0.5 * self._corner))
        return min(reachable, self._fastest)

    def update(
        self,
        q: float,
        dq: float,
        effort: float,
        load: float,
        inertia: float,
        age: float,
        interval: float,
        kept: float = nan,
        was_kept: bool = False,
    ) -> None:
        """Find the bounds for the coming cycle.

        Parameters
        ----------
        q, dq
            The last measurement [rad], [rad/s]; the speed as the board reports it, low-passed.
        effort
            Torque that has acted since then [Nm].
        load, inertia
            What of it the arm's weight and motion take [Nm], and what the joint moves [kg m^2].
        age
            Time since then [s].
        interval
            From the measurement before to this one [s]; 0 if there was none since the last call,
            inf if there was none before.
        kept
            Torque that has acted instead of `effort` if the last command did not reach the board,
            which then goes on with an older one [Nm]; NaN while the board loses no commands.
        was_kept
            Whether such a torque acted between the two last measurements.
        """
        if interval > 0.0 or not self._is_known:
            if was_kept:
                self._acceleration = self._kept_acceleration
            self._take(dq, inertia, interval)
        self.inertia, self._modelled_load = inertia, load
        self.load = load = load + self._disturbance + self._turned
        gain = _FASTEST * inertia
        if not gain < self._gain_max:
            gain = self._gain_max
        self.noise = _SPEED_NOISE * gain
        self._acceleration = (effort - load) / inertia
        self._kept_acceleration = (kept - load) / inertia
        self._lead(self._acceleration, q, dq, age, gain)
        if kept == kept:
            likely = self.q, self.dq, self.filtered
            highest, lowest = self.highest, self.lowest
            self._lead(self._kept_acceleration, q, dq, age, gain)
            self.highest, self.lowest = min(highest, self.highest), max(lowest, self.lowest)
            if abs(likely[1]) > abs(self.dq):
                self.q, self.dq, self.filtered = likely
        most = self._effort_max
        self.is_overwhelmed = self.lowest > most or self.highest < -most

    def _lead(self, acceleration: float, q: float, dq: float, age: float, gain: float) -> None:
        """Predict the joint from its last measurement, and find the bounds that follow."""
        # After a pause nobody knows what torque the last reference made of the motion.
        led = (_APART if age > _APART else age) * acceleration
        mean = self._speed + 0.5 * led
        self.q = q + age * mean
        self.dq = self._speed + led
        self.filtered = mean + self._share_kept(age) * (dq - mean)
        load, inertia = self.load, self.inertia
        self.highest = load + self._bound(self._position_max - self.q, self.dq, gain, inertia)
        self.lowest = load - self._bound(self.q - self._position_min, -self.dq, gain, inertia)

    def gap_damping(
        self, torque: float, law: float = 0.0, stiffness: float = 0.0, damping: float = 0.0
    ) -> float:
        """Return the damping [Nms/rad] that a torque needs if no later command reaches the board.

        It is 0 where the joint would not become too fast without: in `board_timeout` under the
        torque as it is, by the damping that ends it, or by the energy of the spring that makes it.
        It counts with the modelled load and with what was learned of a slight disturbance, each of
        which may be wrong; what was learned of a base turned over may be as large as the torque.

        Parameters
        ----------
        torque
            What the command makes now [Nm].
        law, stiffness, damping
            What the board's law would make if the drive were strong enough [Nm], and how it falls
            as the joint moves [Nm/rad], [Nms/rad].
        """
        load = self._modelled_load
        modelled = self._gap_damping(torque - load, law - load, stiffness, damping)
        load += self._disturbance
        return max(modelled, self._gap_damping(torque - load, law - load, stiffness, damping))

    def _gap_damping(self, excess: float, wanted: float, stiffness: float, damping: float) -> float:
        """Return `gap_damping` [Nms/rad] for torques [Nm] over one load."""
        speed = self.dq
        if excess < 0.0:
            speed, excess, wanted = -speed, -excess, -wanted
        margin = self._disturbance_max
        if damping > 0.0 and abs(speed) > _TURNED_SPEED_SHARE * self._unhindered:
            # A feeble law lets the braking of other joints throw a fast one.
            if speed > 0.0:
                excess, wanted = excess + margin, wanted + margin
            elif excess < margin:
                speed, excess, wanted = -speed, margin - excess, margin - wanted
        room, inertia, stiffness = self._gap_speed - speed, self.inertia, stiffness * self.inertia
        pull, slack = self._gap_pull, self._gap_room_min
        if (excess + pull) * self._gap_time <= room * inertia:
            return 0.0
        # Alone it ends at the speed meant, with a pull a little above it.
        needed = 0.0
        for speed_max, pulled in ((self._gap_speed, 0.0), (self._gap_speed + slack, pull)):
            room, force, law = speed_max - speed, excess + pulled, wanted + pulled
            if (
                force * self._gap_time > room * inertia
                and law >= room * damping
                and law * law >= (speed_max + speed) * room * stiffness
            ):
                needed = max(needed, force / max(room, slack))
        return min(needed, _GAP_FASTEST * inertia)

    def mean_filtered(self, torque: float) -> float:
        """Return the mean of the board's filtered speed [rad/s] in a cycle under a torque [Nm]."""
        cycle = self._cycle
        time = cycle / self._lag
        followed = 1.0 - (1.0 - self._share_kept(cycle)) / time
        led = (torque - self.load) / self.inertia * cycle * (0.5 - followed / time)
        return self.filtered + followed * (self.dq - self.filtered) + led

    def _take(self, dq: float, inertia: float, interval: float) -> None:
        """Take another measured speed [rad/s], an interval [s] after the last."""
        if self._is_known and interval <= _APART and self._acceleration == self._acceleration:
            speed = self._without_lag(dq, interval)
            self._observe(speed, inertia, interval)
        else:
            speed = dq
        self._last_speed, self._speed = dq, speed
        self._is_known = True

    def _observe(self, speed: float, inertia: float, interval: float) -> None:
        """Learn from a speed [rad/s] what the torque of the last interval [s] did not do."""
        missing = inertia * (self._acceleration - (speed - self._speed) / interval)
        learned = self._disturbance + interval / (_DISTURBANCE_TIME + interval) * missing
        largest = self._disturbance_max
        self._disturbance = (
            -largest if learned < -largest else largest if learned > largest else learned
        )
        if abs(speed) > _TURNED_SPEED_SHARE * self._unhindered:
            turned = self._turned + _TURNED_PART * (learned - self._disturbance)
            largest = self._turned_max
            self._turned = min(max(turned, -largest), largest)
        else:
            self._turned *= _TURNED_FADING / (_TURNED_FADING + interval)

    def _without_lag(self, dq: float, interval: float) -> float:
        """Return the speed now [rad/s] of the board's low-passed one, an interval [s] later."""
        kept = self._share_kept(interval)
        mean = (dq - kept * self._last_speed) / (1.0 - kept)
        # The mean is weighted towards now; the torque of that cycle leads it there.
        age = self._lag - interval * kept / (1.0 - kept)
        return mean + age * self._acceleration

    def _share_kept(self, time: float) -> float:
        """Return the share of a speed that the board's low-pass keeps over a time [s]."""
        if not abs(time - self._kept_time) < 1e-7:  # most cycles are alike
            self._kept, self._kept_time = exp(-time / self._lag), time
        return self._kept

    def _bound(self, distance: float, speed: float, gain: float, inertia: float) -> float:
        """Return the largest torque over the load towards a limit [Nm]."""
        allowed = self.speed(distance)
        if allowed >= self._fastest or speed <= 0.0 or self.lets_down:
            braking = 0.0
        elif distance < self._corner:
            braking = self._approach * speed
        else:
            braking = self._deceleration / allowed * speed
        return gain * (allowed - speed) - inertia * braking
