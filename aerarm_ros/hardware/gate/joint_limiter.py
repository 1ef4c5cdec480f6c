"""The limits of one joint."""

from math import nan

from aerarm_ros.description.joint_config import JointConfig
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.joint_barrier import JointBarrier

# What a limit did to a command, for the list of faults.
LIMITED: dict[str, str] = {
    'position': 'a position reference beyond its limit was held at the limit',
    'velocity': 'a reference faster than the velocity limit was slowed to it',
    'soft_zone': "motion towards a position limit was slowed near it, or for another joint's sake",
    'braking': 'a joint was braked before a limit of position or speed',
    'effort': 'an effort above its limit was cut to the limit',
    'effort_rate': 'an effort that changed too fast was slowed',
}


# A reference has at most this share of the speed from which the joint can be braked, and may
# always have this share of the speed limit, or it would never reach the position limit.
_REFERENCE_SHARE = 0.96
_CREEP_SHARE = 0.005


class JointLimiter:
    """Limits what one joint is asked to do, and tells what goes too far to be limited.

    References towards a position limit are slowed to what the joint can still be braked from,
    with a little to spare. What a joint then does is the `barrier`'s.

    Plain numbers, not arrays: for four joints that is faster, and NaN means unused.

    Attributes
    ----------
    position, velocity, effort
        The limited references [rad], [rad/s], [Nm]; NaN where unused.
    effort_limit
        Largest effort [Nm]: that of the configuration, or less while the motor is warm.
    barrier
        Says from which speed the joint can be braked.
    limited
        Names of the limits that acted in the last call, keys of `LIMITED`.
    """

    __slots__ = (
        '_effort_max',
        '_effort_rate_max',
        '_last_effort',
        '_last_position',
        '_name',
        '_position_max',
        '_position_min',
        '_settings',
        '_velocity_max',
        'barrier',
        'effort',
        'effort_limit',
        'limited',
        'position',
        'velocity',
    )

    def __init__(self, joint: JointConfig, settings: BridgeSettings, barrier: JointBarrier) -> None:
        self.position = self.velocity = self.effort = nan
        self.barrier = barrier
        self.limited: list[str] = []
        self._name = joint.name
        self._settings = settings
        self._position_min, self._position_max = joint.position_min, joint.position_max
        self._velocity_max = joint.velocity_max
        self._effort_max = self.effort_limit = joint.effort_max
        self._effort_rate_max = joint.effort_rate_max
        self.restart()

    def restart(self) -> None:
        """Forget the last references: the next ones start from where the joint is."""
        self._last_position = nan
        self._last_effort = 0.0

    def is_inside(self, q: float) -> bool:
        """Whether the joint is within its range, tolerance included."""
        tolerance = self._settings.position_tolerance
        return self._position_min - tolerance <= q <= self._position_max + tolerance

    def state_violation(self, q: float, dq: float) -> str:
        """Return why the joint's position [rad] or velocity [rad/s] demands a stop, or ''."""
        if not self.is_inside(q):
            return (
                f'{self._name} is at {q:.3f} rad, beyond its limits {self._position_min:.3f} to '
                f'{self._position_max:.3f}: disable, bring it back by hand, clear the fault'
            )
        if not abs(dq) <= self._settings.velocity_factor * self._velocity_max:
            return (
                f'{self._name} runs at {dq:.2f} rad/s, its limit is {self._velocity_max:.2f}: '
                'check the controller and the encoder'
            )
        return ''

    def command_violation(self, position: float, velocity: float, effort: float, q: float) -> str:
        """Return why a command demands a stop, or ''; comparisons with NaN are all false."""
        settings, what = self._settings, ''
        if position == position and not self.is_inside(position):
            what = f'a position of {position:.3f} rad, beyond its limits'
        elif abs(position - q) > settings.position_error_max:
            what = f'a position of {position:.3f} rad while it is at {q:.3f}, too far for one step'
        elif abs(velocity) > settings.velocity_factor * self._velocity_max:
            what = f'a velocity of {velocity:.2f} rad/s, its limit is {self._velocity_max:.2f}'
        elif abs(effort) > settings.effort_factor * self._effort_max:
            what = f'an effort of {effort:.2f} Nm, its limit is {self._effort_max:.2f}'
        return what and f'{self._name} was commanded {what}: check the controller'

    def limit(self, position: float, velocity: float, effort: float, q: float, dt: float) -> None:
        """Limit references for a joint at q [rad], dt [s] after the last call."""
        self.limited.clear()
        self.position = position if position != position else self._position(position, q, dt)
        self._last_position = self.position
        self.velocity = velocity
        if velocity == velocity:
            velocity = self._held(velocity, -self._velocity_max, self._velocity_max, 'velocity')
            slowest, fastest = self._speeds(q)
            self.velocity = self._held(velocity, slowest, fastest, 'soft_zone')
        self.effort = self._effort(effort, dt)

    def _speeds(self, q: float) -> tuple[float, float]:
        """Return the most negative and the most positive speed of a reference at q [rad]."""
        most, far = self._velocity_max, self.barrier.far
        if not self.barrier.is_slowed and (
            self._position_min + far <= q <= self._position_max - far
        ):
            return -most, most
        speed, creep = self.barrier.speed, _CREEP_SHARE * most
        up = _REFERENCE_SHARE * speed(self._position_max - q)
        down = _REFERENCE_SHARE * speed(q - self._position_min)
        return -min(max(down, creep), most), min(max(up, creep), most)

    def _position(self, position: float, q: float, dt: float) -> float:
        position = self._held(position, self._position_min, self._position_max, 'position')
        # A reference that steps is led there at the largest speed allowed.
        start = q if self._last_position != self._last_position else self._last_position
        step = self._velocity_max * dt
        position = self._held(position, start - step, start + step, 'velocity')
        slowest, fastest = self._speeds(start)
        return self._held(position, start + slowest * dt, start + fastest * dt, 'soft_zone')

    def _effort(self, effort: float, dt: float) -> float:
        if effort != effort:
            self._last_effort = 0.0
            return effort
        effort = self._held(effort, -self.effort_limit, self.effort_limit, 'effort')
        step = self._effort_rate_max * dt
        last = self._last_effort
        self._last_effort = self._held(effort, last - step, last + step, 'effort_rate')
        return self._last_effort

    def _held(self, value: float, lowest: float, highest: float, name: str) -> float:
        """Return the value held within bounds, and note if that changed it."""
        if lowest <= value <= highest:
            return value
        self.limited.append(name)
        return min(max(value, lowest), highest)
