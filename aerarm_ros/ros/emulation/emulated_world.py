"""The time of the emulated arm: how fast it passes, and for whom it waits."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.node import Node

from aerarm_ros.hardware.emulation.answer_watch import AnswerWatch
from aerarm_ros.realtime.world_loop import WorldLoop
from aerarm_ros.ros.bridge.bridge_streams import BridgeStreams, Command
from aerarm_ros.ros.bridge.cycle_requests import CycleRequests
from aerarm_ros.ros.emulation.flying_drone import FlyingDrone
from aerarm_ros.ros.emulation.recording_watch import RecordingWatch
from aerarm_ros.ros.emulation.world_clock import WorldClock
from aerarm_ros.ros.parameters.parameter import Parameter
from aerarm_ros.ros.states.arm_modes import COMMANDABLE, OFF

KEEP_UP, LOCKSTEP, REAL_TIME = PACES = ('keep_up', 'lockstep', 'real_time')
PACE_PARAMETERS = (
    Parameter(
        'pace',
        KEEP_UP,
        'how the emulated world passes its time. keep_up: as fast as real time, slower where the '
        'host is too slow. lockstep: it waits for the command that answers the last state, and '
        'runs as fast as the host can while it is answered, aligns or homes. real_time: its time '
        'goes on while the host sleeps',
        choices=PACES,
    ),
    Parameter(
        'answer_timeout',
        5.0,
        'longest time on the host that the world waits for who commands or records the arm',
        's',
        0.01,
        600.0,
    ),
)

LAG = {KEEP_UP: 3, LOCKSTEP: 0, REAL_TIME: 0}
"""Number of states, and of odometry messages, that may be without an answer."""

# A world in lockstep stands still in these as soon as the arm does, until somebody does something;
# and hurries in those in which nobody is needed.
_STANDING = (*OFF, 'ready')
_ALONE = ('aligning', 'homing', 'ready')
_SLICE = 0.005  # [s] until requests are looked for again
_EAGER = 0.001  # [s]
_REPEAT = 0.05  # [s] between two tellings of the same state, for who has not heard it


class EmulatedWorld:
    """A world whose time advances by one period a cycle, and stands still between two.

    In lockstep time is that of the answers: the world stands still until the last state is
    answered, while the arm is off and lies, and before its first command, so that the same
    controller finds the same world at the same time in every run. It begins at `start_ns`; with
    `keep_up` it begins at the host's time.

    Parameters
    ----------
    node
        Owner of the topic /clock.
    streams, requests
        Where the bridge's commands and requests come in.
    pace
        `KEEP_UP` or `LOCKSTEP`.
    period, patience
        Of the cycle, and `answer_timeout` [s].
    start_ns
        World time at the start [ns]: zero in a new process; where the bridge is configured once
        more time does not go back.
    is_still
        Returns whether the arm lies or stands still, in a mode since a world time [s].
    tell_again
        Publishes the last state once more.
    wait_idly
        Called while nothing happens, about 20 times a second.
    drone
        Whose flight controller is waited for as well, if there is one.

    Attributes
    ----------
    loop
        The bridge's loop.
    is_waiting
        Whether the wait for an answer was ended by a request: nobody commands the arm then.
    """

    def __init__(
        self,
        node: Node,
        streams: BridgeStreams,
        requests: CycleRequests,
        pace: str,
        period: float,
        patience: float,
        start_ns: int,
        is_still: Callable[[str, float], bool],
        tell_again: Callable[[], None],
        wait_idly: Callable[[], None],
        drone: FlyingDrone | None = None,
    ) -> None:
        self.loop = WorldLoop(period, self._hold, pace == KEEP_UP, start_ns)
        self._origin_ns = time.time_ns() - start_ns if pace == KEEP_UP else 0
        self._clock = WorldClock(node)
        self._logger = node.get_logger()
        self._streams = streams
        self._requests = requests
        self._in_lockstep = pace == LOCKSTEP
        self._watch = AnswerWatch(self.loop.period_ns, LAG[pace])
        self._recording = RecordingWatch(node, self.now_ns())
        self._patience = patience
        self._is_still = is_still
        self._tell_again = tell_again
        self._wait_idly = wait_idly
        self._drone = drone
        self._stands = False
        self._mode = ''
        self._mode_since_ns = 0
        self._command: Command | ValueError | None = None
        self._publishers = 0
        self._warned: set[str] = set()
        self.is_waiting = False

    def now_ns(self) -> int:
        """Return the time of the present cycle [ns since the epoch]."""
        return self._origin_ns + self.loop.world_ns

    def newest_command(self) -> Command | None:
        """Return what `BridgeStreams.newest_command` would have: it was taken before the cycle."""
        command, self._command = self._command, None
        if isinstance(command, ValueError):
            raise command
        return command

    def end_cycle(self, mode: str) -> None:
        """Take the bridge's mode, and tell the time."""
        if mode != self._mode:
            self._mode, self._mode_since_ns = mode, self.loop.world_ns
            self._warned.clear()
        self._clock.tell(self.now_ns())

    def poll(self) -> None:
        """Look for another world in this domain; once a cycle."""
        self._clock.poll()

    def destroy(self) -> None:
        """Destroy publisher and subscription."""
        self._clock.destroy()
        self._recording.destroy()

    def _hold(self) -> bool:
        """Wait until the world may go on; return whether it may hurry."""
        self.is_waiting = False
        if self._mode not in COMMANDABLE or self._mode == 'ready':
            self._watch.forget()  # who commands next is another one, maybe
        self._stands = (
            self._in_lockstep
            and self._mode in _STANDING
            and self._is_still(self._mode, 1e-9 * (self.loop.world_ns - self._mode_since_ns))
        )
        if not (self._in_lockstep and self._watch.awaits(self.now_ns())):
            self._look()  # else it is waited for
        if self._stands:
            self._stand()
            return True
        if self._is_ahead() and not self._wait(self._is_ahead, self._patience):
            self._give_up()
        is_answered = self._watch.expects or (self._drone is not None and self._drone.expects)
        return self._in_lockstep and (is_answered or self._mode in _ALONE)

    def _stand(self) -> None:
        """Wait until somebody does something, which takes no time in the world."""
        begun = time.monotonic_ns()
        if not self._wait(lambda: self._command is None, self._patience):
            if self._mode == 'ready' and self._streams.commands.publishers():
                self._say(
                    'joint_command has a publisher that answers no state: the emulated world '
                    'stands still until it does (one told again wants an answer too)'
                )
            self._wait(lambda: self._command is None, None)
        if not self.loop.is_stopped:  # the wait before a cycle that comes
            self.loop.stood_ns += time.monotonic_ns() - begun

    def _is_ahead(self) -> bool:
        """Whether the world would run away from who commands or records the arm."""
        now_ns = self.now_ns()
        if self._recording.is_behind(now_ns) or self._is_drone_behind():
            return True
        return self._is_arm_behind(now_ns)

    def _is_drone_behind(self) -> bool:
        return self._drone is not None and self._drone.is_behind()

    def _is_arm_behind(self, now_ns: int) -> bool:
        if not self._watch.awaits(now_ns):
            return False
        if not self._in_lockstep and self._streams.commands.publishers() < self._publishers:
            self._watch.forget()  # it has ended: there is nobody to wait for
        return self._watch.expects

    def _wait(self, is_needed: Callable[[], bool], patience: float | None) -> bool:
        """Wait while it is needed, or until something is asked; False if that takes too long."""
        waited = 0.0  # while the others could run as well: a pause of the host does not count
        last = told = time.monotonic()
        has_told = False
        while is_needed() and not (self.loop.is_stopped or self._requests.are_waiting):
            # An answer takes a fraction of a millisecond: who looks again at once has it sooner
            # than who is woken up.
            is_eager = self._in_lockstep and waited < _EAGER
            self._listen(0.0 if is_eager else _SLICE)
            now = time.monotonic()
            waited += min(now - last, 4 * _SLICE)
            last = now
            if patience is not None and waited > patience:
                return False
            if now - told > _REPEAT:
                told, has_told = now, True
                self._tell_again()
                if self._drone is not None:
                    self._drone.tell_again()
                self._clock.tell_again()
                self._wait_idly()
        self.is_waiting = self._is_alone(has_told)
        return True

    def _listen(self, timeout: float) -> None:
        """Wait for who is waited for, up to `timeout` [s], and take what came."""
        drone = self._drone
        if drone is not None and drone.is_behind() and not self._awaits_command():
            drone.wait(timeout)
        elif self._streams.commands.wait(timeout):  # for one, or while the recorder is behind
            self._look()
        if drone is not None:
            drone.look()

    def _awaits_command(self) -> bool:
        return self._stands or self._watch.awaits(self.now_ns())

    def _is_alone(self, has_told: bool) -> bool:
        """Whether nobody commands the arm, after a wait with or without telling the state again."""
        commands = self._streams.commands
        if not self._watch.awaits(self.now_ns()):
            return False
        return has_told or commands.publishers() < self._publishers

    def _look(self) -> None:
        """Take the newest command, if there is one."""
        try:
            command = self._streams.newest_command()
        except ValueError as error:
            self._command = self._command or error  # it replaces no answer, either
            return
        if command is None or self._is_early(command[1].stamp_ns):
            return
        stamp_ns, now_ns = command[1].stamp_ns, self.now_ns()
        if self._watch.expects and not self._watch.is_answer(stamp_ns, now_ns):
            # A stranger's: it must neither replace an answer nor end the wait for one.
            self._command = self._command or command
            return
        self._command = command
        if not self._watch.expects:
            self._publishers = self._streams.commands.publishers()
        self._watch.note(stamp_ns, now_ns)

    def _is_early(self, stamp_ns: int) -> bool:
        """Whether a first command answers a state before the one at which the world stands."""
        if not self._in_lockstep or self._mode != 'ready' or self._watch.expects:
            return False
        is_answer = self._watch.is_answer(stamp_ns, self.now_ns())
        return is_answer and not (self._stands and stamp_ns == self.now_ns())

    def _give_up(self) -> None:
        if self._recording.is_behind(self.now_ns()):
            self._recording.give_up()
            self._warn('the recorder did not go on', 'and the bag may lack messages')
        elif self._drone is not None and self._drone.is_behind():
            self._drone.give_up()
            self._warn('the last odometry was not answered', 'and the rotors will stop')
        else:
            self._watch.give_up()
            self._warn(
                'the last state was not answered',
                'and the arm is damped, or held if that was asked for',
            )

    def _warn(self, what: str, then: str) -> None:
        self._say(
            f'{what} within {self._patience:g} s: the emulated world goes on without, {then} '
            '(answer_timeout lengthens the wait)'
        )

    def _say(self, text: str) -> None:
        if text not in self._warned:
            self._warned.add(text)
            self._logger.warning(text)
