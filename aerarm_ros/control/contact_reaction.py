"""Reaction of a controller to a reported contact of the arm: stop, retreat or comply."""

from collections import deque
from typing import Any, Protocol

import numpy as np

from aerarm_ros.control.checks import RejectedInputError, positive
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.references.trajectory_follower import TrajectoryFollower
from aerarm_ros.motion.signals import Array, Reaction

_STEP = 0.01  # [s] between two postures that a retreat may go back to
_SILENT = 0.5  # [s] after which the last report of contact is out of date
_RELEASED = 0.5  # [s] without contact after which a compliant arm is stiff again


class ComplyingLaw(Protocol):
    """Interface of a control law whose stiffness can be lowered."""

    stiffness_share: float


class ContactReaction:
    """Stops the arm, moves it back, or makes it compliant when the arm touches something.

    The motion under way stops along its path as fast as the acceleration limits allow. RETREAT then
    returns to where the reference was `retreat_time` before the contact; a second contact on the
    way stops it. COMPLY lowers the stiffness of the law, which becomes an impedance of little
    stiffness, until 0.5 s after the contact; the arm then holds where it is. During contact the
    disturbance is not compensated, because it is the contact. A contact of an arm at rest changes
    nothing, except with COMPLY.

    Parameters
    ----------
    follower : TrajectoryFollower
        Moves the reference.
    loop : ControlLoop
        Compensates the disturbance.
    law : ComplyingLaw
        Of the loop.
    retreat_time : float
        [s]
    comply_stiffness : float
        Share of the law's stiffness that is left during COMPLY.

    Attributes
    ----------
    reaction : Reaction
        Reaction to the next contact; may be replaced at any time. A reaction that has begun lasts
        until its contact ends.
    in_contact : bool
    count : int
        Number of reactions so far.

    Raises
    ------
    ValueError
        If a number is not positive.
    """

    def __init__(
        self,
        follower: TrajectoryFollower,
        loop: ControlLoop[Any],
        law: ComplyingLaw,
        retreat_time: float = 0.3,
        comply_stiffness: float = 0.02,
    ) -> None:
        self.reaction = Reaction.REPORT
        self.in_contact = False
        self.count = 0
        self._follower, self._loop, self._law = follower, loop, law
        self._comply_stiffness = positive('comply_stiffness', comply_stiffness)
        self._retreat_time = positive('retreat_time', retreat_time)
        self._past: deque[tuple[float, Array]] = deque()
        self._take_overs = loop.take_overs
        self._retreat: int | None = None  # number of the follower's motion that is a retreat
        self._reported = self._touched = -np.inf
        self._reacts = False  # to the present contact

    @property
    def complies(self) -> bool:
        """Whether the arm is compliant at present because of a contact."""
        return self._law.stiffness_share < 1.0

    def is_silent(self, now: float) -> bool:
        """Return whether the last contact report is more than 0.5 s older than `now` [s]."""
        return not 0.0 <= now - self._reported < _SILENT

    def report(self, in_contact: bool, now: float) -> None:
        """Process a report, received at `now` [s], of whether the arm is in contact."""
        begins = in_contact and not self.in_contact
        self.in_contact, self._reported = in_contact, now
        if begins:
            self._reacts = self.reaction is not Reaction.REPORT
            if self._reacts:
                self._react(now)

    def update(self, q: Array, now: float) -> None:
        """Update the reaction at the posture `q` (n,) [rad]; call before the control law."""
        self.in_contact = self.in_contact and not self.is_silent(now)
        if self.in_contact:
            self._touched = now
        reacts = self._reacts or self.reaction is not Reaction.REPORT
        self._loop.touched = self.in_contact and reacts
        if self.complies and now - self._touched > _RELEASED:
            self._law.stiffness_share = 1.0
            self._follower.take_over(q)
            self._past.clear()
        self._remember(now)

    def check_stream(self) -> None:
        """Raise RejectedInputError if streamed points are rejected because of a contact."""
        if self.in_contact and self.reaction is not Reaction.REPORT:
            raise RejectedInputError(
                'streamed point rejected: something touches the arm (contact_reaction '
                f'{self.reaction.value}): remove the contact, or send a trajectory away from the '
                'contact'
            )

    def _remember(self, now: float) -> None:
        """Store the reference for a later retreat; clear the store after an activation."""
        past = self._past
        if self._take_overs != self._loop.take_overs:
            self._take_overs = self._loop.take_overs
            past.clear()
        if past and not 0.0 <= now - past[-1][0] < self._retreat_time:
            past.clear()
        if not past or now - past[-1][0] >= _STEP:
            past.append((now, self._follower.reference.q))
        while now - past[0][0] > self._retreat_time:
            past.popleft()

    def _react(self, now: float) -> None:
        follower, reaction = self._follower, self.reaction
        if reaction is Reaction.COMPLY:
            self._law.stiffness_share = self._comply_stiffness
            self._touched = now
        # A follower that stops has the status 'holding' but still moves.
        moves = follower.status != 'holding' or follower.moves
        if not moves and reaction is not Reaction.COMPLY:
            return
        self.count += 1
        if moves:
            # Nothing touched the arm on the way from there, unless this way is a retreat: it
            # began at another contact.
            retreats = reaction is Reaction.RETREAT and follower.motion != self._retreat
            back = self._past[0][1] if retreats and self._past else None
            follower.stop(now, f'stopped: contact ({reaction.value})', back)
            self._retreat = None if back is None else follower.motion
