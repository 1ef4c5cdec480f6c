"""What torque one warm motor may still give."""

from math import inf, sqrt

from aerarm_ros.description.joint_config import JointConfig
from aerarm_ros.description.motor_config import RATED_AMBIENT
from aerarm_ros.hardware.heat.motor_temperature import MotorTemperature

# Below the largest temperature of the winding [K]: a warning, the first reduction of the torque,
# and what the continuous current is reached at. The stop is at the largest temperature itself.
_WARNING, _REDUCTION, _CONTINUOUS = 30.0, 20.0, 5.0
# An arm that is held by its barrier although it was stopped is let down this much above it [K].
_LETTING_DOWN = 5.0
# A warning comes this long [s] before the torque is reduced, ...
_WARNING_TIME = 30.0
# ... at the mean current of this time [s].
_MEAN_TIME = 2.0
# A state ends this much [K] below where it began.
_HYSTERESIS = 3.0
# [1/s] of the torque limit: it falls in a second at most, and comes back more slowly.
_FALL, _RISE = 1.0, 0.2
# Share of the reduced torque that a load may take before the arm counts as sinking, and as held.
_SINKING, _HELD = 1.0, 0.9
# Of the mean load that counts there, this share is the newest: 0.1 s at 50 updates in a second.
_LOAD_SHARE = 0.2


class ThermalLimit:
    """Warns of a motor that gets warm, then reduces its torque, then asks for a stop.

    The limit of the squared current falls with the winding's temperature, from that of the effort
    limit to the continuous one, which is reached 5 K below the largest temperature. With the
    continuous current the winding settles there. So no command brings the winding
    beyond it; what does is a load that the joint's barrier must hold at a limit.

    Parameters
    ----------
    joint
        The joint with its motor.
    ambient, start
        Temperatures of the air, and of the motor at first [degC].

    Attributes
    ----------
    motor
        The estimate.
    continuous_current
        Current [A] with which the winding settles 5 K below its largest temperature.
    effort_limit
        Torque that a command may ask of the joint [Nm].
    remaining
        Time to the first reduction at the present current [s]: 0 once it is reduced, inf if it
        never will be.
    is_sinking
        Whether the arm's weight is more than the reduced torque.
    lets_down
        Whether the joint can no longer be held at a limit, but is let down slowly, until its motor
        is off.
    """

    __slots__ = (
        '_ambient',
        '_continuous',
        '_duration',
        '_effort_max',
        '_is_warm',
        '_largest',
        '_load',
        '_name',
        '_per_ampere',
        '_square',
        '_stops',
        '_sum',
        '_temperature_max',
        'continuous_current',
        'effort_limit',
        'is_sinking',
        'lets_down',
        'motor',
        'remaining',
    )

    def __init__(self, joint: JointConfig, ambient: float, start: float) -> None:
        thermal = joint.motor.thermal_or_guess
        self.motor = MotorTemperature(joint.motor, ambient, start)
        self.remaining = inf
        self.is_sinking = self.lets_down = False
        self._load = 0.0
        self._name = joint.name
        self._effort_max = self.effort_limit = joint.effort_max
        self._per_ampere = joint.torque_per_ampere
        self._largest = (joint.effort_max / joint.torque_per_ampere) ** 2
        self._temperature_max = hottest = thermal.temperature_max
        # Warmer air takes less heat away.
        rise = max(hottest - _CONTINUOUS - ambient, 1.0) / (hottest - RATED_AMBIENT)
        self._continuous = min(rise * thermal.continuous_current**2, self._largest)
        self.continuous_current = sqrt(self._continuous)
        self._square = 0.0  # mean of some seconds
        self._sum = self._duration = 0.0
        self._is_warm = self._stops = False

    @property
    def is_reduced(self) -> bool:
        """Whether the joint has less than its whole torque."""
        return self.effort_limit < self._effort_max

    def add(self, current: float, duration: float) -> None:
        """Take a current [A] that flowed for a time [s]."""
        self._sum += current * current * duration
        self._duration += duration

    def update(self, resistance: float) -> None:
        """Take the time since the last call; the board reports a resistance [ohm], 0 for none."""
        duration = self._duration
        if duration <= 0.0:
            return
        square = self._sum / duration
        self._sum = self._duration = 0.0
        self.motor.report(resistance)
        self.motor.update(square, duration)
        self._square += duration / (_MEAN_TIME + duration) * (square - self._square)
        winding, hottest = self.motor.winding, self._temperature_max
        self._stops = winding >= hottest
        self.lets_down = self.lets_down or winding > hottest + _LETTING_DOWN
        warm = hottest - _WARNING - (_HYSTERESIS if self._is_warm else 0.0)
        self._is_warm = winding > warm or self.remaining < _WARNING_TIME
        self._limit(duration)

    def forecast(self) -> None:
        """Find out how much time is left; once a second is enough."""
        threshold = self._temperature_max - _REDUCTION
        self.remaining = self.motor.time_until(threshold, self._square)

    def carries(self, load: float) -> None:
        """Take the load [Nm] that the arm's weight and motion put on the joint, after `update`."""
        self._load += _LOAD_SHARE * (load - self._load)
        share = _HELD if self.is_sinking else _SINKING
        self.is_sinking = self.is_reduced and abs(self._load) > share * self.effort_limit

    def rest(self) -> None:
        """Take note that the motor is off."""
        self.is_sinking = self.lets_down = False
        self._load = 0.0

    def stop(self) -> str:
        """Return why the arm has to stop, or ''."""
        if not self._stops:
            return ''
        return (
            f'the motor of {self._name} has {self.motor.winding:.0f} degC (estimated), its largest '
            f'temperature is {self._temperature_max:.0f}: support the arm, disable it, let it cool'
        )

    def refusal(self) -> str:
        """Return why the motor may not be driven yet, or ''."""
        cool = self._temperature_max - _REDUCTION
        if self.motor.winding <= cool:
            return ''
        return (
            f'the motor of {self._name} has {self.motor.winding:.0f} degC (estimated): '
            f'wait until it has cooled to {cool:.0f}'
        )

    def warning(self) -> str:
        """Return what is to be said of the motor, or ''."""
        name, temperature = self._name, f'{self.motor.winding:.0f} degC (estimated)'
        if self.lets_down:
            return f'{name} is let down beyond its limit, its motor has {temperature}: support it'
        if self.is_sinking:
            return (
                f'{name} sinks: its motor has {temperature} and only {self.effort_limit:.2f} of '
                f'{self._effort_max:.2f} Nm, less than the load: fold or support the arm'
            )
        if self.is_reduced:
            return (
                f'the torque of {name} is reduced to {self.effort_limit:.2f} of '
                f'{self._effort_max:.2f} Nm, its motor has {temperature}: fold the arm, let it rest'
            )
        if not self._is_warm:
            return ''
        if self.remaining == inf:
            return f'the motor of {name} has {temperature}: let it rest'
        return (
            f'the motor of {name} has {temperature}, at this load its torque is reduced in '
            f'{self.remaining:.0f} s: fold the arm or lower its load'
        )

    def _limit(self, duration: float) -> None:
        """Move the torque limit to what the temperature allows."""
        left = self._temperature_max - _CONTINUOUS - self.motor.winding
        share = min(max(left / (_REDUCTION - _CONTINUOUS), 0.0), 1.0)
        square = self._continuous + share * (self._largest - self._continuous)
        wanted = self._effort_max if share == 1.0 else sqrt(square) * self._per_ampere
        fall, rise = _FALL * self._effort_max * duration, _RISE * self._effort_max * duration
        limit = min(max(wanted, self.effort_limit - fall), self.effort_limit + rise)
        self.effort_limit = min(limit, self._effort_max)
