"""An arm that follows velocity commands exactly, as a process, with faults on request.

The process replaces the bridge in tests with an arm that gets stuck, falls silent or faults. The
time of its stamps pauses while an answer is awaited, so measurements do not depend on the machine.
"""

import argparse
import sys
import time

import numpy as np
import rclpy
from std_msgs.msg import String

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.realtime.periodic_loop import PeriodicLoop
from aerarm_ros.ros.process.process_end import StopSignals

NAMES = ('joint1', 'joint2', 'joint3', 'joint4')
PERIOD = 1e-3
SPEED = 4  # largest speed of the arm's time, relative to real time
PATIENCE = 50 * SPEED  # cycles without an answer


class IdealArm:
    def __init__(self, options: argparse.Namespace) -> None:
        self.node = rclpy.create_node('ideal_arm')
        state, mode = topics.JOINT_STATES, topics.ARM_MODE
        names = NAMES[::-1] if options.reversed else NAMES
        self.states = self.node.create_publisher(state.type, state.name, state.qos)
        self.modes = self.node.create_publisher(mode.type, mode.name, mode.qos)
        self.commands = RawReader(self.node, topics.JOINT_COMMAND)
        self.codec = JointStateCdr(names)
        self.command_codec = JointStateCdr(NAMES)
        self.order = [NAMES.index(name) for name in names]
        self.options = options
        self.q = np.array(options.start)
        self.dq = np.zeros(4)
        self.answered: list[int] = []
        self.commanded: list[np.ndarray] = []
        self.sent: set[int] = set()
        self.efforts = 0  # commands with effort
        self.moved_for = 0.0
        self.waited = 0
        self.next_damping = 0.5  # [s] of motion
        self.time_ns = time.time_ns()
        self.trace: list[np.ndarray] = []
        self.set_mode(options.mode)

    def set_mode(self, mode: str) -> None:
        self.modes.publish(String(data=mode))

    def cycle(self, *_: object) -> None:
        message = self.commands.take_newest()
        if message is not None:
            command = self.command_codec.unpack(message[0])
            assert command is not None
            assert command.velocity is not None, command
            assert command.position is None or self.options.full
            self.efforts += command.effort is not None
            self.dq = np.array(command.velocity)
            self.answered.append(command.stamp_ns)
            self.commanded.append(self.dq)
        elif self.answered and self.waited < PATIENCE:
            self.waited += 1
            return
        self.waited = 0
        self.time_ns += round(PERIOD * 1e9)
        stamp = self.time_ns
        if self.answered:
            self.moved_for += PERIOD
        if self.moved_for < self.options.stuck_after:
            self.q = self.q + PERIOD * self.dq
        if self.options.damped and self.moved_for >= self.next_damping:
            self.next_damping += 0.5 if self.next_damping < 1.0 else np.inf
            for mode in ('damping', 'running'):
                self.set_mode(mode)
                time.sleep(self.options.damped)
        if self.moved_for >= self.options.fault_after:
            self.set_mode('fault')
            self.options.fault_after = np.inf
        if self.moved_for < self.options.silent_after:
            self.sent.add(stamp)
            self.states.publish(
                self.codec.pack(stamp, self.q[self.order], self.dq[self.order], np.zeros(4))
            )
        self.trace.append(np.concatenate([[stamp * 1e-9], self.q, self.dq]))

    def save(self) -> None:
        foreign = sum(stamp not in self.sent for stamp in self.answered)
        np.savez(
            self.options.out,
            trace=np.array(self.trace),
            answered=np.array(self.answered, dtype=np.int64) * 1e-9,
            commanded=np.array(self.commanded).reshape(-1, 4),
            foreign=foreign,
            efforts=self.efforts,
        )


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument('--out', required=True)
    parser.add_argument('--mode', default='ready')
    parser.add_argument('--start', type=float, nargs=4, default=[0.1, 1.4, -0.1, 0.2])
    parser.add_argument('--reversed', action='store_true')
    parser.add_argument('--full', action='store_true')
    parser.add_argument('--damped', type=float, default=0.0, help='for how long, twice [s]')
    for fault in ('stuck', 'silent', 'fault'):
        parser.add_argument(f'--{fault}-after', type=float, default=np.inf)
    rclpy.init()
    arm = IdealArm(parser.parse_args())
    loop = PeriodicLoop(PERIOD / SPEED)
    with StopSignals(loop.stop):
        loop.run(arm.cycle)
    arm.save()
    return 0


if __name__ == '__main__':
    sys.exit(main())
