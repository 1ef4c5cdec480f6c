"""How far a motor must have turned while its encoder told of no motion."""

from math import copysign, nan

# Motion counts once a joint must have turned by this much [rad]: 90 counts of its encoder.
_CLEARLY = 5e-3
_LOOKS_MIN = 3  # that saw no motion; a frame that comes twice is one
# A motor near its limit may lack what friction takes; but nothing holds it there for so long [s].
_STRAINED_SHARE = 0.9
_STRAINED_MAX = 0.1
# What a look finds wrong corrects the speed [1/s], and the load [1/s^2]: known within 10 ms.
_SPEED_RATE = 200.0
_LOAD_RATE = 15e3
_LOOKED = 4e-3  # [s]; a longer interval corrects no more
_COUNTS = 3e-3  # [rad, motor side] two counts: the error of an angle's change, ...
_SHORTEST = 1e-4  # [s] ... and the time that it took at least
# In a second a load changes by twice what the joint may carry: the base turns, the arm too.
_LOAD_TURNS = 2.0


class ExpectedMotion:
    """Follows the load of a motor that is seen to move, and its motion once it is seen to stand.

    Nothing about the arm's weight is believed but what the motion tells: the torque that did not
    accelerate the motor is its load, with any payload, on a base turned any way. While the angle
    stands, a motor with that load and with more friction than any is led by its current. Its
    speed does not end between two looks, and torque beyond the load accelerates it; so if it had
    to turn clearly and its angle has not changed by a count, the angle is wrong, or the joint is
    blocked. So it is if the motor's whole current does not change it by a count for a time.

    A motor that creeps tells a count in some looks and none in others. Both are learnt from: by
    those that tell one alone it is faster than it is, and its load would fall and fall.

    On the side of rest: a load that the motor gives way to may be carried by something else, a
    changing load may be what the current changes for, and nobody saw what happened in a pause.

    Motor side; plain numbers, not arrays: for four joints that is faster.

    Parameters
    ----------
    load_max
        Current that load and friction may ask for [A].
    current_max
        The motor's limit [A].
    torque_per_ampere, ratio
        Of the joint [Nm/A], and its speed over the motor's.
    """

    __slots__ = (
        '_clearly',
        '_current',
        '_impulse',
        '_is_followed',
        '_load',
        '_looks',
        '_modelled',
        '_moved',
        '_per_inertia',
        '_rate',
        '_seen_speed',
        '_speed',
        '_stood',
        '_strained',
        '_strong',
        '_turned',
    )

    def __init__(
        self, load_max: float, current_max: float, torque_per_ampere: float, ratio: float
    ) -> None:
        self._strong = _STRAINED_SHARE * current_max
        self._rate = _LOAD_TURNS * load_max
        self._per_inertia = torque_per_ampere / ratio
        self._clearly = _CLEARLY / ratio
        self._load = self._current = self._modelled = nan
        self._speed = self._seen_speed = self._turned = self._stood = self._strained = 0.0
        self._moved = self._impulse = 0.0  # [rad/s] when its angle last changed, [A s] since
        self._looks = 0
        self._is_followed = True

    def restart(self) -> None:
        """Forget what it did: it rests, and what its current is now is its load."""
        self._load = self._current = self._modelled = nan
        self._rest()

    def update(
        self,
        change: float,
        elapsed: float,
        current: float,
        inertia: float,
        friction: float,
        modelled: float = 0.0,
    ) -> bool:
        """Take a look; return whether it must have turned clearly since its angle last changed.

        Parameters
        ----------
        change
            Of the angle since the last look [rad].
        elapsed
            Time since then [s].
        current
            [A].
        inertia
            Of the joint [kg m^2].
        friction
            Current that may hold the motor [A].
        modelled
            Its load as the arm's model has it [A]. Only changes count, and they only widen what
            the load may be: other joints that push against something accelerate in the model.
        """
        if self._load != self._load:
            self._load, self._modelled = current, modelled
        gain = self._per_inertia / inertia  # [rad/s^2 / A]
        if change != 0.0:
            self._see(change, elapsed, current, gain)
            self._modelled = modelled
            return False
        if not self._looks:
            self._begin(elapsed, gain)
        self._looks += 1
        self._stood += elapsed
        self._impulse += current * elapsed
        self._current = current
        drive = abs(current - self._load)
        if self._speed == 0.0 and drive <= friction and abs(current) <= self._strong:
            # Most joints rest most of the time.
            self._turned = self._strained = 0.0
            self._follow(current, elapsed)
            return False
        self._lead(elapsed, current, gain, friction + abs(modelled - self._modelled))
        self._strained = self._strained + elapsed if abs(current) > self._strong else 0.0
        if self._strained > _STRAINED_MAX:
            return True
        return self._looks >= _LOOKS_MIN and abs(self._turned) > self._clearly

    def pause(self, change: float, elapsed: float, current: float) -> None:
        """Take a look after a time [s] in which nobody saw what the current did; as `update`.

        Whatever the speed was, it may be gone. But what stood before and stands now has stood.
        """
        if change != 0.0 or not self._looks:
            self._rest()
        self._is_followed = False
        self._follow(current, elapsed)

    def _rest(self) -> None:
        self._moved = self._impulse = 0.0
        self._speed = self._seen_speed = self._turned = self._stood = self._strained = 0.0
        self._looks = 0
        self._is_followed = True

    def _see(self, change: float, elapsed: float, current: float, gain: float) -> None:
        """Take an angle that has changed: by what the current did not do, correct the load."""
        impulse = self._impulse + current * elapsed
        elapsed += self._stood
        seen = change / elapsed
        if not self._is_followed or (self._stood and elapsed > _LOOKED):
            self._speed = seen  # a mean over more than is known of the currents
        else:
            predicted = self._moved + (impulse - self._load * elapsed) * gain
            wrong = seen - predicted
            looked = min(elapsed, _LOOKED)
            self._speed = predicted + _SPEED_RATE * looked * wrong
            self._load -= _LOAD_RATE * looked * wrong / gain
        self._seen_speed, self._current = seen, current
        self._moved, self._impulse = self._speed, 0.0
        self._turned = self._stood = self._strained = 0.0
        self._looks = 0
        self._is_followed = True

    def _begin(self, elapsed: float, gain: float) -> None:
        """Find the least speed that it can have had at the end of the last look's motion."""
        seen, way = self._seen_speed, copysign(1.0, self._seen_speed)
        speed = min(abs(seen), max(way * self._speed, 0.0))
        speed -= _COUNTS / max(elapsed, _SHORTEST)
        # The look told of the mean: the torque that braked it has led it on.
        braked = min(way * (self._current - self._load), 0.0) * gain * 0.5 * elapsed
        self._speed = way * max(speed + braked, 0.0)
        self._seen_speed = self._turned = 0.0

    def _lead(self, elapsed: float, current: float, gain: float, friction: float) -> None:
        """Lead the motor on by the least that its current must do."""
        load, speed = self._load, self._speed
        # Something else may carry a load that the motor gives way to.
        carried = min(max(current, min(load, 0.0)), max(load, 0.0))
        drive = current - carried
        if speed != 0.0:
            way = copysign(1.0, speed)
            pulled = min(way * drive, way * (current - load)) - friction
            after = speed + way * pulled * gain * elapsed
            after = after if after * speed > 0.0 else 0.0
        else:
            excess = max(abs(drive) - friction, 0.0)
            after = copysign(excess * gain * elapsed, drive)
        self._turned = self._turned + 0.5 * (speed + after) * elapsed if after else 0.0
        self._speed = after
        self._follow(current, elapsed)

    def _follow(self, current: float, elapsed: float) -> None:
        """Let the load be what the current changes for, as fast as a load may change."""
        step = self._rate * elapsed
        self._load += min(max(current - self._load, -step), step)
