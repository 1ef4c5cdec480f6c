"""Simulation time of the emulated arm; the simulation can wait for other nodes."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node

from aerarm_msgs_py import topics
from aerarm_ros.hardware.bridge_modes import COMMANDABLE, OFF
from aerarm_ros.hardware.emulation.emulated_transport import AnswerWatch, EmulatedTransport
from aerarm_ros.realtime.periodic_loop import OK, PeriodicLoop, TimingSummary, sleep_until
from aerarm_ros.ros.bridge.hardware_bridge import Command, HardwareBridge
from aerarm_ros.ros.emulation.flying_drone import FlyingDrone
from aerarm_ros.ros.graph import DuplicatePublisherWatch
from aerarm_ros.ros.parameters.parameter import Parameter

# Below this fraction of real time, the summary warns that the host is too slow for a real arm.
_SHARE_MIN = 0.99
# [ns] Smaller total delays are harmless, because a bridge damps its arm after this time without a
# command.
_NOTICED_SLIP_NS = 50_000_000


class WorldLoop(PeriodicLoop):
    """Loop that calls a function once per period of simulation time.

    On a fast host the deadlines have equal distances in real time, as for a `PeriodicLoop`. If the
    host is late by a period or more, all later deadlines shift. So no cycle is skipped.

    Parameters
    ----------
    period
        Simulation time between cycles [s].
    hold
        Called before each cycle; blocks while the simulation must wait, and returns whether the
        cycle may start before its deadline.
    wait_first
        Whether to wait for the deadline before calling `hold`. If the loop waits first, `hold`
        blocks only on a slow host. With False, `hold` is called at once, and a cycle may start
        early.

    Attributes
    ----------
    period_ns, cycles, lateness, execution, interval
        As for a `PeriodicLoop`, in the host's time. No cycle is ever missed.
    slipped_ns
        Total shift of the deadlines [ns].
    paused_ns
        Total duration of pauses in which the arm was at rest [ns]; `hold` adds to it. These pauses
        do not count in `share_of_real_time`.

    Raises
    ------
    ValueError
        If the period is not between 10 us and 1000 s.
    """

    def __init__(
        self, period: float, hold: Callable[[], bool], wait_first: bool = True, start_ns: int = 0
    ) -> None:
        super().__init__(period)
        self.slipped_ns = self.paused_ns = 0
        self._hold = hold
        self._wait_first = wait_first
        self._host_ns = 0
        self._start_ns = start_ns

    @property
    def world_ns(self) -> int:
        """Simulation time of the present or last cycle [ns]."""
        return self._start_ns + self.cycles * self.period_ns

    def run(self, function: Callable[[int, int], None]) -> None:
        """Call `function(world_ns, index)` once per period of simulation time until `stop()`.

        Parameters
        ----------
        function
            Function of the simulation time [ns], which is one period at the first call, and of the
            number of the cycle, 0, 1, 2... An exception ends the loop.
        """
        clock = time.monotonic_ns
        previous = clock()
        due = previous + self.period_ns
        while True:
            due = self._wait(due)
            if self._stopped:
                return
            now = clock()
            self.interval.add(now - previous)
            self._host_ns += now - previous
            previous = now
            self.cycles += 1
            function(self.world_ns, self.cycles - 1)
            self.execution.add(clock() - now)
            due += self.period_ns

    def _wait(self, due: int) -> int:
        """Wait for the next cycle and return its deadline."""
        clock = time.monotonic_ns
        if self._wait_first:
            sleep_until(due)
            self.lateness.add(clock() - due)
            self._hold()
        elif self._hold():
            now = clock()
            if now < due:
                return now
        else:
            sleep_until(due)
            self.lateness.add(clock() - due)
        late = clock() - due
        if late < self.period_ns:
            return due
        self.slipped_ns += late
        return due + late

    @property
    def share_of_real_time(self) -> float:
        """Simulation time divided by the host's time since the start; may be larger than one."""
        host_ns = self._host_ns - self.paused_ns
        return self.cycles * self.period_ns / host_ns if host_ns > 0 else 1.0

    def assess(self, interval: TimingSummary, execution: TimingSummary) -> tuple[int, str]:
        """Return level and text for /diagnostics; the level is OK even for a slow simulation."""
        return OK, f'the simulation runs at {100.0 * self.share_of_real_time:.1f} % of real time'

    def account(self) -> str:
        """Return a text about the speed of the simulation, for the last line of the log."""
        if not self.cycles:
            return 'no cycle has run yet'
        share = self.share_of_real_time
        text = f'{self.cycles} cycles, the simulation ran at {100.0 * share:.1f} % of real time'
        is_slow = share < _SHARE_MIN and self.slipped_ns >= _NOTICED_SLIP_NS
        if self._wait_first and is_slow:
            text += (
                f' and fell {self.slipped_ns * 1e-9:.2f} s behind real time: this computer is too '
                'slow for a real arm'
            )
        return text


_LAG_NS = 500_000_000
"""Delay of a recorder [ns] above which the simulation waits; queues can store some seconds."""


class RecordingWatch:
    """Check whether a recorder keeps up with the simulation.

    A recorder publishes the stamp of the newest joint state that it has received.

    Parameters
    ----------
    node
        Owner of the subscription; its executor receives the messages.
    start_ns
        Start of the simulation [ns since the epoch]. Earlier stamps belong to another simulation,
        for example of a second bridge.
    """

    def __init__(self, node: Node, start_ns: int) -> None:
        self._node = node
        self._start_ns = start_ns
        self._until_ns: int | None = None
        self._subscription = topics.RECORDED_UNTIL.subscription(node, self._on_time)

    def is_behind(self, now_ns: int) -> bool:
        """Return whether the recorder is more than 0.5 s behind the simulation time `now_ns`."""
        until_ns = self._until_ns
        if until_ns is None or now_ns - until_ns <= _LAG_NS:
            return False
        if self._subscription.get_publisher_count() == 0:
            self._until_ns = None  # the recorder has ended
        return self._until_ns is not None

    def give_up(self) -> None:
        """Ignore the recorder until it publishes a stamp again."""
        self._until_ns = None

    def destroy(self) -> None:
        """Destroy the subscription."""
        self._node.destroy_subscription(self._subscription)

    def _on_time(self, message: Time) -> None:
        until_ns = message.sec * 1_000_000_000 + message.nanosec
        if until_ns >= self._start_ns:
            self._until_ns = until_ns


_PERIOD_NS = 5_000_000
_ADVICE = (
    ', each with a different time: set a different ROS_DOMAIN_ID for each, or remap /clock of all '
    'but one'
)
# rosgraph_msgs/Clock: header of little-endian CDR, seconds, nanoseconds.
_CDR = struct.Struct('<4BiI')
_ENCAPSULATION = (0, 1, 0, 0)


class WorldClock:
    """Publish the simulation time on /clock at 200 Hz.

    Parameters
    ----------
    node
        Owner of the publisher.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = topics.CLOCK.publisher(node)
        self._due = 0
        self._serialized = b''
        self._duplicates = DuplicatePublisherWatch(node, topics.CLOCK, _ADVICE)

    def publish(self, now_ns: int) -> None:
        """Publish the simulation time `now_ns` [ns] if 5 ms have passed since the last message."""
        if now_ns >= self._due:
            self._due = now_ns + _PERIOD_NS
            self._serialized = _CDR.pack(*_ENCAPSULATION, *divmod(now_ns, 1_000_000_000))
            self._publisher.publish(self._serialized)

    def republish(self) -> None:
        """Publish the last message again, for late subscribers."""
        if self._serialized:
            self._publisher.publish(self._serialized)

    def poll(self) -> None:
        """Check for another publisher of /clock; call this method in every cycle (takes 1 us)."""
        self._duplicates.poll()

    def destroy(self) -> None:
        """Destroy the publisher."""
        self._duplicates.destroy()
        self._node.destroy_publisher(self._publisher)


KEEP_UP, LOCKSTEP, REAL_TIME = PACES = ('keep_up', 'lockstep', 'real_time')
PACE_PARAMETERS = (
    Parameter(
        'pace',
        KEEP_UP,
        'pace of the simulation. keep_up: real time, or slower on a slow computer. lockstep: each '
        'cycle waits for the command that answers the last joint state. The simulation then runs '
        'as fast as possible while commands arrive, and during alignment and homing. real_time: '
        'real time, without waiting for other nodes',
        choices=PACES,
    ),
    Parameter(
        'answer_timeout',
        5.0,
        'longest time (wall clock) for which the simulation waits for a node that commands or '
        'records the arm',
        's',
        0.01,
        600.0,
    ),
)

LAG = {KEEP_UP: 3, LOCKSTEP: 0, REAL_TIME: 0}
"""Largest number of unanswered joint states or odometry messages, by pace."""

# In these modes a simulation in lockstep pauses as soon as the arm rests, until a request or
# message arrives.
_PAUSING = (*OFF, 'ready')
# In these modes no controller is needed, so the simulation runs as fast as possible.
_ALONE = ('aligning', 'homing', 'ready')
_SLICE = 0.005  # [s] between two checks for requests
_EAGER = 0.001  # [s]
_REPEAT = 0.05  # [s] between two copies of a state, for nodes that missed the first
_CYCLES_OF_A_WAIT = 10  # reports of the bridge between two copies
_STILL = 0.05  # [rad/s] largest speed of a joint at rest
_FALL_TIME = 2.0  # [s] after which an arm without motor current has begun to fall


class EmulatedWorld:
    """Control the speed of the simulation time, for the paces `keep_up` and `lockstep`.

    In lockstep the simulation waits for the command that answers the last joint state. The
    simulation also pauses before the first command, and while the motors are off and the arm is at
    rest. A controller therefore receives the same states at the same times in every run. With
    `lockstep` the simulation time starts at `start_ns`, with `keep_up` at the host's time.

    Parameters
    ----------
    bridge
        Bridge whose parameter `pace` is `KEEP_UP` or `LOCKSTEP`.
    boards
        Boards of the simulated arm.
    drone
        Drone whose flight controller the simulation waits for, or None.
    start_ns
        Simulation time at the start [ns], zero in a new process. A bridge that is configured again
        continues at its last time.

    Attributes
    ----------
    loop
        The bridge's loop.
    is_waiting
        Whether a request ended the wait for an answer of a controller that has ended or does not
        respond.
    """

    def __init__(
        self,
        bridge: HardwareBridge,
        boards: EmulatedTransport,
        drone: FlyingDrone | None,
        start_ns: int,
    ) -> None:
        pace = bridge.values.pace
        self.loop = WorldLoop(bridge.values.period, self._hold, pace == KEEP_UP, start_ns)
        self._origin_ns = time.time_ns() - start_ns if pace == KEEP_UP else 0
        self._clock = WorldClock(bridge)
        self._bridge, self._boards, self._drone = bridge, boards, drone
        self._streams, self._requests = bridge.streams, bridge.requests
        self._in_lockstep = pace == LOCKSTEP
        self._watch = AnswerWatch(self.loop.period_ns, LAG[pace])
        self._recording = RecordingWatch(bridge, self.now_ns())
        self._patience = bridge.values.answer_timeout
        self._awake_until_ns = 0
        self._is_pausing = False
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
        """Return the newest of the joint commands received before the cycle, or None.

        Raises ValueError if that command is invalid.
        """
        command, self._command = self._command, None
        if isinstance(command, ValueError):
            raise command
        return command

    def end_cycle(self, mode: str) -> None:
        """Store the bridge's mode at the end of a cycle, and publish the simulation time.

        The method also checks for another simulation in this ROS domain.
        """
        if mode != self._mode:
            self._mode, self._mode_since_ns = mode, self.loop.world_ns
            self._warned.clear()
        self._clock.publish(self.now_ns())
        self._clock.poll()

    def keep_awake(self, duration: float) -> None:
        """Do not pause for `duration` [s] of simulation time, although the arm may be at rest."""
        self._awake_until_ns = self.loop.world_ns + round(1e9 * duration)

    def destroy(self) -> None:
        """Destroy publisher and subscription."""
        self._clock.destroy()
        self._recording.destroy()

    def _hold(self) -> bool:
        """Wait until the simulation may continue; return whether the next cycle may start now.

        Otherwise the next cycle starts at its deadline.
        """
        self.is_waiting = False
        if self._mode not in COMMANDABLE or self._mode == 'ready':
            self._watch.forget()  # The next command may come from another controller.
        self._is_pausing = self._in_lockstep and self._mode in _PAUSING and self._is_still()
        if not (self._in_lockstep and self._watch.awaits(self.now_ns())):
            self._look()  # otherwise the wait below reads it
        if self._is_pausing:
            self._pause()
            return True
        if self._is_ahead() and not self._wait(self._is_ahead, self._patience):
            self._give_up()
        is_answered = self._watch.expects or (self._drone is not None and self._drone.expects)
        return self._in_lockstep and (is_answered or self._mode in _ALONE)

    def _is_still(self) -> bool:
        """Return whether arm and drone are at rest."""
        cycle, now_ns = self._bridge.cycle, self.loop.world_ns
        if cycle is None or np.abs(cycle.dq).max() > _STILL or now_ns < self._awake_until_ns:
            return False
        if self._drone is not None and self._drone.is_flying:
            return False
        # A released arm rests at first, then falls.
        has_fallen = now_ns - self._mode_since_ns > 1e9 * _FALL_TIME
        return self._mode not in OFF or self._boards.is_carried or has_fallen

    def _pause(self) -> None:
        """Pause the simulation until a command or request arrives."""
        begun = time.monotonic_ns()
        if not self._wait(lambda: self._command is None, self._patience):
            if self._mode == 'ready' and self._streams.commands.publishers():
                self._warn_once(
                    'the controller that publishes joint_command does not respond to joint states, '
                    'so the simulation pauses: check the controller'
                )
            self._wait(lambda: self._command is None, None)
        if not self.loop.is_stopped:  # the wait before the next cycle
            self.loop.paused_ns += time.monotonic_ns() - begun

    def _is_ahead(self) -> bool:
        """Return whether the simulation must wait for a controller, drone or recorder."""
        now_ns = self.now_ns()
        if self._recording.is_behind(now_ns):
            return True
        if self._drone is not None and self._drone.is_behind():
            return True
        if not self._watch.awaits(now_ns):
            return False
        if not self._in_lockstep and self._streams.commands.publishers() < self._publishers:
            self._watch.forget()  # the node has ended, so do not wait for it
        return self._watch.expects

    def _wait(self, is_needed: Callable[[], bool], patience: float | None) -> bool:
        """Wait until `is_needed` returns False or a request arrives; return False at a time-out."""
        waited = 0.0  # counts only while other processes could run
        last = republished = time.monotonic()
        has_republished = False
        while is_needed() and not (self.loop.is_stopped or self._requests.are_waiting):
            # An answer takes a fraction of a millisecond, so polling is faster than a blocking
            # wait.
            is_eager = self._in_lockstep and waited < _EAGER
            self._listen(0.0 if is_eager else _SLICE)
            now = time.monotonic()
            waited += min(now - last, 4 * _SLICE)
            last = now
            if patience is not None and waited > patience:
                return False
            if now - republished > _REPEAT:
                republished, has_republished = now, True
                self._republish()
        # A request ended the wait for a controller that has ended or does not respond.
        self.is_waiting = self._watch.awaits(self.now_ns()) and (
            has_republished or self._streams.commands.publishers() < self._publishers
        )
        return True

    def _republish(self) -> None:
        """Publish state, odometry and clock again, and report as often as in some cycles."""
        cycle = self._bridge.cycle
        if cycle is not None:
            self._streams.publish_joints(self.now_ns(), (cycle.q_known, cycle.dq, cycle.tau))
        if self._drone is not None:
            self._drone.republish()
        self._clock.republish()
        for _ in range(_CYCLES_OF_A_WAIT):
            self._bridge.report()
            self._clock.poll()

    def _listen(self, timeout: float) -> None:
        """Wait up to `timeout` [s] for a joint or rotor command, and read new commands."""
        drone = self._drone
        awaits_command = self._is_pausing or self._watch.awaits(self.now_ns())
        if drone is not None and drone.is_behind() and not awaits_command:
            drone.wait(timeout)
        elif self._streams.commands.wait(timeout):  # for a command, or while the recorder is behind
            self._look()
        if drone is not None:
            drone.look()

    def _look(self) -> None:
        """Read the newest joint command, and check which joint state it answers."""
        try:
            command = self._streams.newest_command()
        except ValueError as error:
            self._command = self._command or error  # an invalid command replaces no answer
            return
        if command is None or self._is_early(command[1].stamp_ns):
            return
        stamp_ns, now_ns = command[1].stamp_ns, self.now_ns()
        if self._watch.expects and not self._watch.is_answer(stamp_ns, now_ns):
            # A command of another node must neither replace an answer nor end the wait.
            self._command = self._command or command
            return
        self._command = command
        if not self._watch.expects:
            self._publishers = self._streams.commands.publishers()
        self._watch.note(stamp_ns, now_ns)

    def _is_early(self, stamp_ns: int) -> bool:
        """Return whether the first command of a controller answers an earlier joint state."""
        if not self._in_lockstep or self._mode != 'ready' or self._watch.expects:
            return False
        is_answer = self._watch.is_answer(stamp_ns, self.now_ns())
        return is_answer and not (self._is_pausing and stamp_ns == self.now_ns())

    def _give_up(self) -> None:
        if self._recording.is_behind(self.now_ns()):
            self._recording.give_up()
            self._warn('the recorder did not receive the joint states', 'the bag may lack messages')
        elif self._drone is not None and self._drone.is_behind():
            self._drone.give_up()
            self._warn('no rotor_command answered the last odometry', 'the rotors will stop')
        else:
            self._watch.give_up()
            self._warn(
                'no joint_command answered the last joint state',
                'the bridge damps the arm, or holds it if requested',
            )

    def _warn(self, what: str, then: str) -> None:
        self._warn_once(
            f'{what} within {self._patience:g} s (answer_timeout), so the simulation '
            f'continues without waiting, and {then}'
        )

    def _warn_once(self, text: str) -> None:
        if text not in self._warned:
            self._warned.add(text)
            self._bridge.get_logger().warning(text)
