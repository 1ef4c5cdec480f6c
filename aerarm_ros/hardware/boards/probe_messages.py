"""What a client asks of the bridge while an arm is commissioned, and the bridge's answer, as JSON.

A client repeats its request as long as it wants it: the last answer is always that to its last
request, a lost message costs nothing, and a motor stops for a client that falls silent.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

WATCH, DRIVE, OFF = KINDS = ('watch', 'drive', 'off')
_LONGEST = 64  # characters of a name
_LONGEST_REQUEST = 1024  # characters; a node with other work reads it


@dataclass(frozen=True)
class ProbeRequest:
    """What the bridge shall do now.

    Attributes
    ----------
    id
        Client and number, as 'a1b2:3'. The same id continues what it began.
    kind
        'watch' counts how far motors that are off are turned, from the first request on. 'drive'
        turns one motor forth and back. 'off' ends both.
    joint
        Name of the joint to drive.
    """

    id: str
    kind: str
    joint: str = ''

    @property
    def client(self) -> str:
        """Name of the client."""
        return self.id.partition(':')[0]

    def text(self) -> str:
        """Return the request as JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def parse(cls, text: str) -> ProbeRequest:
        """Read a request; raises ValueError, with what is wrong, for any other text."""
        if len(text) > _LONGEST_REQUEST:
            raise ValueError(f'{len(text)} characters are no commissioning request')
        fields = _object(text)
        values = [fields.get(key, '') for key in ('id', 'kind', 'joint')]
        if not all(isinstance(value, str) and len(value) <= _LONGEST for value in values):
            raise ValueError('id, kind and joint of a commissioning request are short texts')
        request = cls(*values)
        if not request.client or request.kind not in KINDS:
            raise ValueError(f'a commissioning request has an id and a kind of {", ".join(KINDS)}')
        return request


@dataclass(frozen=True)
class Stroke:
    """Means over a motor's motion in one direction of its joint.

    Attributes
    ----------
    requested, measured
        Current that the board's law asked for and that the board measured [A], positive where it
        drives the joint to larger angles by the configuration's sign.
    speed
        Of the joint by the configuration's gear [rad/s].
    """

    requested: float
    measured: float
    speed: float


@dataclass(frozen=True)
class ProbeReport:
    """The bridge's answer; arrays have one value per joint, in the arm's order.

    Attributes
    ----------
    id
        Of the request that is answered.
    phase
        'off', 'watching', 'aligning', 'driving', 'done' or 'failed'.
    reason
        Why it failed.
    mode
        The arm's mode.
    joints
        Names.
    boards
        What is wrong with each joint's board, '' for a board that answers.
    travel, span
        Motor angle since the request began, and its range since then [rad].
    pulses
        Index pulses since then.
    pulse_angle
        Mean angle of these pulses, counted as `travel` and modulo a motor turn [rad]; None
        without one.
    strokes
        Of a drive that is done, in the positive and the negative direction.
    current_max
        Largest current of a drive [A].
    emulated
        Whether the boards are emulated.
    """

    id: str
    phase: str
    reason: str
    mode: str
    joints: tuple[str, ...]
    boards: tuple[str, ...]
    travel: tuple[float, ...]
    span: tuple[float, ...]
    pulses: tuple[int, ...]
    pulse_angle: tuple[float | None, ...]
    strokes: tuple[Stroke, ...] = ()
    current_max: float = 0.0
    emulated: bool = False

    def text(self) -> str:
        """Return the report as JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def parse(cls, text: str) -> ProbeReport:
        """Read a report; raises ValueError for any other text."""
        fields = _object(text)
        try:
            strokes = [Stroke(**stroke) for stroke in fields.pop('strokes')]
            lists: dict[str, Any] = {
                key: tuple(value) if isinstance(value, list) else value
                for key, value in fields.items()
            }
            report = cls(strokes=tuple(strokes), **lists)
            arrays = (report.boards, report.travel, report.span, report.pulses, report.pulse_angle)
            n = len(lists['joints'])
            if not all(isinstance(array, tuple) and len(array) == n for array in arrays):
                raise ValueError('an array does not have one value per joint')
            numbers = [*report.travel, *report.span, *report.pulses, report.current_max]
            if not all(isfinite(number) for number in numbers):
                raise ValueError('a number is not finite')
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            raise ValueError(f'not a commissioning report: {error}') from None
        return report


def _object(text: str) -> dict[str, Any]:
    try:
        fields = json.loads(text)
    except (ValueError, RecursionError):
        fields = None
    if not isinstance(fields, dict):
        raise ValueError('a commissioning message is a JSON object')
    return fields
