"""Error of the contact force that `base_reaction` estimates, without contact and with known forces.

`fake_hardware`, `computed_torque`, `base_reaction` and `flight_control` run as processes in
lockstep. The drone hovers, and the benchmark calls `zero_contact` (except with `--raw`). Then the
arm swings slowly, then fast, and during fast motion a force of 2, 5 and 10 N pulls its tool. The
benchmark compares the published with the true force in the world frame. Without contact it prints
the RMS and maximum errors. For a pull, it prints the error of the mean force over one second and
the maximum error, from 1.5 s after the start of the pull (`contact_bandwidth` 1 Hz).
"""

import argparse
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import rclpy
from flying.arm_model import ArmModel
from flying.arm_swing import ArmSwing
from flying.flight_bench import QUICK_LEAD, FlightBench
from flying.flight_case import WAYS, FlightCase, load_drone
from flying.node_bench import PATIENCE, ros_node
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation, Slerp
from std_srvs.srv import Trigger

from aerarm_msgs_py import topics
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.excitation.trajectory import MotionSequence, Stage

RAMP = 1.0  # [s]
ZEROING = 3.0  # [s]
SLOW, FAST, PULL = 3.0, 3.0, 2.5  # [s] duration of each motion
SETTLED = 1.5  # [s]
PULLS = ([2.0, 0.0, 0.0], [0.0, -5.0, 0.0], [0.0, 0.0, -10.0])  # [N] in the world
NOISY = ('odometry_noise', [0.01, 0.02, 0.005, 0.01])
AT_TOOL = ('contact_link', 'tool0')
CASES = {
    'nothing wrong': {'sensors': (AT_TOOL,)},
    "drone's mass and inertia 10 % too large": {'sensors': (AT_TOOL,), 'believed': 1.1},
    'odometry noise 10 mm, 20 mm/s, 5 mrad, 10 mrad/s': {'sensors': (AT_TOOL, NOISY)},
}

Words = list[tuple[float, np.ndarray]]


def swings() -> MotionSequence:
    fast = FAST + PULL * len(PULLS) + 2.0 * RAMP
    slow = ArmSwing('slow', SLOW + 2.0 * RAMP, RAMP)
    return MotionSequence([Stage('slow', slow), Stage('fast', ArmSwing('fast', fast, RAMP))])


def fly(
    node: Node, name: str, arm: ArmModel, case: dict[str, object], is_zeroed: bool
) -> list[str]:
    """Return the force errors of one case [N]."""
    drone, way = load_drone(name), WAYS['posture, motion, lead']
    flight = tuple(way.parameters(name).items())
    wanted = FlightCase(drone.mass, 'free', drone=drone, flight=flight, is_told=True, **case)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        bench = FlightBench(stack, node, Path(folder), wanted, arm)
        begin, told = pull(bench, node, is_zeroed)
        record = bench.listener.record().shifted(begin)
    known, rows = np.unique(record.times, return_index=True)  # drop republished forces
    turned = Slerp(known, Rotation.from_quat(record.attitudes[rows]))
    inside = [(t - begin, f) for t, f in told if known[0] <= t - begin <= known[-1]]
    times = np.array([time for time, _ in inside])
    in_body = np.array([force for _, force in inside]) @ drone.mount.rotation.T
    return figures(times, turned(times).apply(in_body))


def pull(bench: FlightBench, node: Node, is_zeroed: bool) -> tuple[float, Words]:
    """Return the start of the swings [s], and the published contact forces in base axes."""
    reader = RawReader(node, topics.CONTACT_WRENCH)
    bench.wait_until_still()
    zeroed, _ = bench.listener.next()
    if is_zeroed:
        client = node.create_client(Trigger, 'base_reaction/zero_contact')
        client.wait_for_service(PATIENCE)
        client.call_async(Trigger.Request())
        while bench.listener.next()[0] < zeroed + ZEROING:
            rclpy.spin_once(node, timeout_sec=0.0)
    begin = bench.listener.next()[0] + QUICK_LEAD
    motion = swings()
    bench.send(motion, begin)
    changes = [(pull_begin(i), force) for i, force in enumerate([*PULLS, []])]
    told: Words = []
    now = -np.inf
    while now < begin + motion.duration:
        now, _ = bench.listener.next()
        while (raw := reader.take()) is not None:
            message = deserialize_message(raw[0], WrenchStamped)
            force, stamp = message.wrench.force, message.header.stamp
            told.append((stamp.sec + 1e-9 * stamp.nanosec, np.array([force.x, force.y, force.z])))
        if changes and now > begin + changes[0][0]:
            bench.change_world('contact_force', changes.pop(0)[1])
    reader.destroy()
    return begin, told


def pull_begin(index: int) -> float:
    """Return the start time of a pull [s]."""
    return SLOW + 3.0 * RAMP + FAST + PULL * index


def figures(times: np.ndarray, forces: np.ndarray) -> list[str]:
    """Return the force errors in each part."""
    cells = []
    fast = SLOW + 3.0 * RAMP
    for begin, end in ((RAMP, RAMP + SLOW), (fast + 1.0, fast + FAST)):
        size = np.linalg.norm(forces[(times >= begin) & (times < end)], axis=1)
        cells.append(f'{np.sqrt(np.mean(size**2)):.2f} ({size.max():.2f})')
    for index, force in enumerate(PULLS):
        begin = pull_begin(index) + SETTLED
        errors = forces[(times >= begin) & (times < begin + PULL - SETTLED)] - force
        mean, most = np.linalg.norm(errors.mean(axis=0)), np.linalg.norm(errors, axis=1).max()
        cells.append(f'{mean:.2f} ({most:.2f})')
    return cells


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--drone', default='tilted_hexarotor')
    ArmModel.add_options(parser)
    parser.add_argument('--raw', action='store_true', help='do not call zero_contact before')
    parser.add_argument('--cases', nargs='*', default=list(CASES), choices=list(CASES))
    options = parser.parse_args()
    print(f'{options.drone} with the arm {options.model}; forces in N')
    print('| | slow | fast | 2 N | 5 N | 10 N |')
    with tempfile.TemporaryDirectory() as folder:
        arm = ArmModel.chosen(options, Path(folder))
        for case in options.cases:
            with ros_node() as node:
                cells = fly(node, options.drone, arm, CASES[case], not options.raw)
            print(f'| {case} | {" | ".join(cells)} |', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
