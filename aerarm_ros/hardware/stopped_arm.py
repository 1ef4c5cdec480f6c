"""The way out of a latched stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class StoppedArm:
    """What of a stopped arm decides how it is brought back.

    Attributes
    ----------
    boards
        Number and name of each board that is in fault, or whose encoder is doubted.
    violation
        Whether it is beyond a limit, so that it would stop again at once.
    driven
        Whether all its motors are still driven and aligned.
    until_power_cycle
        Whether its boards keep an error until their supply was off.
    zero_unknown
        Whether an encoder counts from nobody knows where.
    absolute
        Whether all its encoders know their angles after a power cycle.
    latched
        Whether the stop is still latched; without it the arm is off, and its zero unknown.
    """

    boards: Sequence[tuple[int, str]] = ()
    violation: bool = False
    driven: bool = True
    until_power_cycle: bool = True
    zero_unknown: bool = False
    absolute: bool = False
    latched: bool = True


def way_out(arm: StoppedArm, emulated: bool) -> str:
    """Return what to do, one step after the other, divided by commas; commands are in quotes.

    Without a fault of a board or an encoder, and inside its limits, a driven arm is held where it
    is. All else goes through idle: a board that restarted has to align, and clearing a fault would
    not be accepted, or last. What has lost an encoder's zero, or will by a power cycle, is homed
    from its home configuration. Emulated boards are mended by a command; on real ones it is said
    what hands have to do.
    """
    if not arm.latched:
        return "'arm home'" if emulated else "bring the arm to its home configuration, 'arm home'"
    steps = []
    through_idle = bool(arm.boards) or arm.violation or arm.zero_unknown
    restarts = bool(arm.boards) and (emulated or arm.until_power_cycle)
    homes = (arm.zero_unknown or restarts) and not (arm.absolute and restarts)
    if through_idle:
        steps += ["'arm disable'"] if emulated else ['support the arm', "'arm disable'"]
    if emulated:
        steps += [f"'arm fault power_cycle:{number}'" for number, _ in arm.boards]
    elif arm.boards:
        steps.append('mend the cause')
        if arm.until_power_cycle:
            steps += [f'switch the supply of {name} off and on' for _, name in arm.boards]
    if not emulated and homes:  # where home and enable do it
        steps.append('bring the arm to its home configuration')
    elif not emulated and arm.violation:
        steps.append('move the arm inside its limits by hand')
    steps.append("'arm clear_fault'")
    if homes:
        steps.append("'arm home'")
    elif through_idle or not arm.driven:
        steps.append("'arm enable'")
    return ', '.join(steps)
