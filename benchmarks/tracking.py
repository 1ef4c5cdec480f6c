"""Tracking error of `computed_torque` at 1 kHz over ROS topics, with the exact arm model.

`fake_hardware` and `computed_torque` run as processes, as on a robot, with a five-harmonic
trajectory of 0.1 to 0.5 Hz, on a still base and on one that swings by 30 degrees at 0.5 Hz. The
error is computed from joint_states, relative to the reference at each state's stamp; an encoder
count is 0.05 to 0.06 mrad at the joint. The same run without topics, in `make experiment`, gives
the lower bound that an ideal middleware would reach.
"""

import argparse
import tempfile
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from flying.node_bench import NodeBench, ros_node
from rclpy.node import Node
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointSample, JointStateCdr
from aerarm_msgs_py.live_topics import RawReader
from aerarm_ros.control.base.base_motion_estimator import FULL, NONE
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.excitation.excitation_setup import ExcitationSetup, RandomTrajectory
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.excitation.trajectory import RampedExcitation
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError
from aerarm_ros.ros.requests.motion_request import trajectory_message
from aerarm_ros.simulation.arm_plant import PlantParameters
from aerarm_ros.simulation.base_profile import MOVING, STILL

FUNDAMENTAL, HARMONICS, AMPLITUDE = 0.1, 5, 0.15
# Feedback, base_motion_profile of fake_hardware, base_motion of the controller.
RUNS = (
    ('host', STILL, NONE),
    ('boards', STILL, NONE),
    ('host', MOVING, FULL),
    ('boards', MOVING, FULL),
    ('host', MOVING, NONE),
)
LINE = '{:9} {:7} {:5} {:28} {:28} {}'
LEAD = 2.0  # [s] from sending to the start
GOAL = 1.0  # [mrad]


def draw_motion(seed: int, periods: int) -> RampedExcitation:
    """Return a trajectory that is safe to play."""
    config, robot, settings = load_arm_config(), load_robot(), load_excitation_config()
    setup = ExcitationSetup.of_arm(robot, config, settings)
    candidates = RandomTrajectory(
        settings.bias_of(robot), settings.bias_spread, AMPLITUDE, FUNDAMENTAL, HARMONICS
    )
    trajectory, _ = candidates.draw_feasible(seed, setup.checker, settings.ramp_time)
    return RampedExcitation(trajectory, periods, settings.ramp_time)


def start_arm(bench: NodeBench, feedback: str, base: str, awareness: str) -> ArmClient:
    """Start bridge and controller, and wait until the arm follows the controller."""
    config, robot = load_arm_config(), load_robot()
    load_friction = PlantParameters.nominal(config, robot).load_friction.tolist()
    arm = {'seed': -1, 'encoders': 'absolute', 'base_motion_profile': base}
    arm['realtime_priority'] = 80
    law = {
        'feedback': feedback,
        'base_motion': awareness,
        'load_friction': load_friction,
        'realtime_priority': 70,
    }
    bench.start('fake_hardware', arm)
    bench.start('computed_torque', law)
    client = ArmClient(bench.node)
    client.wait_for_mode(['idle'], 60.0)
    client.call('enable')
    client.wait_for_mode(['running'], 60.0)
    return client


def require_running(client: ArmClient, folder: Path) -> None:
    """If the bridge has stopped the arm, end the benchmark with the reason."""
    try:
        client.wait_for_mode(['running'], 2.0)
    except ArmClientError as error:
        logs = (path.read_text()[-600:] for path in sorted(folder.glob('*.log')))
        raise SystemExit(f'tracking: {error}\n' + ''.join(logs)) from None


class ArmStates:
    """Subscriber to the joint states of the arm; their stamps are the time of the benchmark."""

    def __init__(self, node: Node, names: tuple[str, ...]) -> None:
        self._reader = RawReader(node, topics.JOINT_STATES)
        self.publishers = self._reader.publishers
        self._codec = JointStateCdr(names)

    def next(self) -> JointSample:
        """Return the next joint state of the arm."""
        for _ in range(100):
            message = self._reader.take_newest() if self._reader.wait(0.1) else None
            sample = self._codec.unpack(message[0]) if message else None
            if sample is not None:
                return sample
        raise SystemExit('tracking: no joint states for 10 s')

    def until(self, stamp_ns: int) -> list[JointSample]:
        """Return the states that arrive until a time [ns]."""
        samples = [self.next()]
        while samples[-1].stamp_ns < stamp_ns:
            samples.append(self.next())
        return samples


def track(
    motion: RampedExcitation, feedback: str, base: str, awareness: str
) -> tuple[np.ndarray, np.ndarray, float]:
    """Return RMS and maximum errors (n,) [mrad], and the fraction of states recorded."""
    names = load_arm_config().joint_names
    with tempfile.TemporaryDirectory() as folder, ros_node() as node, ExitStack() as stack:
        bench = NodeBench(stack, node, Path(folder))
        client = start_arm(bench, feedback, base, awareness)
        states = ArmStates(node, names)
        goals, publisher = map(bench.publisher_of, (topics.SET_POINT, topics.JOINT_TRAJECTORY))
        for each in (goals, publisher):
            bench.wait('computed_torque', each.get_subscription_count)
        goals.publish(JointState(name=names, position=motion.evaluate(0.0).q.tolist()))
        states.until(states.next().stamp_ns + 4_000_000_000)
        begin = states.next().stamp_ns + round(LEAD * 1e9)
        publisher.publish(trajectory_message(motion, names, begin))
        samples = states.until(begin + round(motion.duration * 1e9))
        require_running(client, Path(folder))
        if states.publishers() > 1:
            raise SystemExit(
                'tracking: another bridge runs in this ROS domain: stop it, and try again'
            )
    when = np.array([(sample.stamp_ns - begin) * 1e-9 for sample in samples])
    moving = (when > motion.ramp_time) & (when < motion.duration - motion.ramp_time)
    q = np.array([sample.position for sample in samples])
    error = 1e3 * (q - motion.evaluate(when).q)[moving]
    share = moving.sum() / (1e3 * motion.periodic_duration)
    return np.sqrt((error**2).mean(axis=0)), np.abs(error).max(axis=0), float(share)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seed', type=int, default=1, help='seed of the trajectory')
    parser.add_argument(
        '--periods', type=int, default=1, help='number of periods of 10 s per motion'
    )
    options = parser.parse_args()
    motion = draw_motion(options.seed, options.periods)
    headings = ('feedback', 'base', 'uses', 'joints RMS [mrad]', 'joints max [mrad]', 'heard')
    print(LINE.format(*headings))
    for run in RUNS:
        rms, largest, share = track(motion, *run)
        errors = (' '.join(f'{x:.2f}' for x in column) for column in (rms, largest))
        print(LINE.format(*run, *errors, f'{100 * share:.1f} %'), flush=True)
    print(
        f'Goals: on a still base RMS below {GOAL:g} mrad on every joint; on a moving base at '
        'most 1.5 times\n'
        'as much with the IMU, and more without the IMU.'
    )


if __name__ == '__main__':
    main()
