"""Joint error of an arm under a drone as light as itself, over topics, beside a fixed base.

`fake_hardware`, `computed_torque` and `flight_control` run as processes, in lockstep, so that the
figures do not depend on the host. Drones of other masses are the packaged ones, scaled: lengths as
they are, inertia in proportion to mass^(5/3), thrust to the weight of drone and arm. The arm hangs
down; "slow" swings its joints by 0.4 to 0.5 rad at 0.2 to 0.35 Hz, "fast" by 0.5 to 0.8 rad at
0.5 to 0.9 Hz. Errors are taken from joint_states, each against the reference at its own stamp.
"""

import argparse
import os
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import rclpy
import yaml
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from tracking import as_message

from aerarm_msgs_py import topics
from aerarm_msgs_py.codecs.joint_state_cdr import JointStateCdr
from aerarm_msgs_py.live_topics.raw_reader import RawReader
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import DroneConfig, load_drone_config
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.motion.smooth_step import smooth_step
from aerarm_ros.ros.process.node_process import NodeProcess
from aerarm_ros.ros.requests.arm_client import ArmClient, ArmClientError
from aerarm_ros.simulation.plant_parameters import PlantParameters

HANGING = np.array([0.0, np.pi / 2, 0.0, 0.0])
MOTIONS = {  # amplitude [rad], frequency [Hz]
    'slow': (np.array([0.4, 0.5, 0.45, 0.5]), np.array([0.2, 0.25, 0.3, 0.35])),
    'fast': (np.array([0.5, 0.8, 0.6, 0.7]), np.array([0.5, 0.6, 0.75, 0.9])),
}
MASSES = (1.3, 2.0, 3.0, 5.0, 10.0)
BASES = ('none', 'attitude', 'full', 'free')
RAMP, LEAD = 2.0, 2.5  # [s]
CHEAP = {'imu_noise': [0.3, 0.01], 'imu_bias': [0.2, 0.01], 'imu_attitude_error': 0.01}
LINE = '{:>7} {:9} {:24} {:5} {:>13} {:>8} {:>9} {:>7}'


@dataclass(frozen=True)
class Case:
    """One pair of processes: what flies, what the controller makes of it, what is wrong."""

    mass: float  # [kg]; 0 for a fixed base
    base: str
    variant: str = 'as its file says'
    believed: float = 1.0  # the controllers' mass and inertia over the true ones
    sensors: tuple[tuple[str, object], ...] = ()
    hears_rotors: bool = True


class Oscillation:
    """A sine a joint about a posture, grown from rest and back."""

    def __init__(self, motion: str, seconds: float) -> None:
        self.amplitude, self.frequency = MOTIONS[motion]
        self.duration = seconds

    def evaluate(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q, dq, ddq, (M, n) each."""
        times = np.atleast_1d(times)[:, None]
        rise, fall = smooth_step(times / RAMP), smooth_step((self.duration - times) / RAMP)
        # Only one of the two is not at its end.
        g = rise.value * fall.value
        dg = (rise.slope - fall.slope) / RAMP
        ddg = (rise.curvature + fall.curvature) / RAMP**2
        w = 2.0 * np.pi * self.frequency
        s, c = np.sin(w * times), np.cos(w * times)
        a = self.amplitude
        return (
            HANGING + a * g * s,
            a * (dg * s + g * w * c),
            a * (ddg * s + 2.0 * dg * w * c - g * w**2 * s),
        )


def scaled(mass: float) -> DroneConfig:
    """Return a drone of a mass [kg]: the quadrotor up to 1.5 kg, else the hexarotor."""
    name = ('drones', 'quadrotor.yaml') if mass < 1.5 else ('drone.yaml',)
    drone = load_drone_config(resource('config', *name))
    arm = float(load_robot().inertial_parameters[:, 0].sum())
    thrust = (mass + arm) / (drone.mass + arm)
    rotors = tuple(replace(r, thrust_max=thrust * r.thrust_max) for r in drone.rotors)
    # Rotors first: each step must be a drone that flies.
    strong = replace(drone, rotors=rotors)
    return strong.with_errors(mass / drone.mass, (mass / drone.mass) ** (5 / 3))


def write(drone: DroneConfig, path: Path) -> Path:
    """Write a drone file."""
    poses = {
        key: {'position': list(pose.position), 'rpy': list(pose.rpy)}
        for key, pose in (('mount', drone.mount), ('imu', drone.imu))
    }
    keys = ('name', 'position', 'axis', 'moment_per_thrust', 'thrust_max', 'time_constant')
    rotors = [{key: getattr(rotor, key) for key in keys} for rotor in drone.rotors]
    for rotor in rotors:
        rotor.update(position=list(rotor['position']), axis=list(rotor['axis']))
    plain = {
        'name': drone.name,
        'mass': drone.mass,
        'centre_of_mass': list(drone.centre_of_mass),
        'inertia': list(drone.inertia),
        'size': list(drone.size),
    }
    path.write_text(yaml.safe_dump({**plain, **poses, 'rotors': rotors}))
    return path


class FlightListener:
    """What the arm and the drone say, with the world's time."""

    def __init__(self, node: Node) -> None:
        self._reader = RawReader(node, topics.JOINT_STATES, topics.ODOMETRY)
        self._codec = JointStateCdr(load_arm_config().joint_names)
        self.farthest = 0.0

    def next(self) -> tuple[float, np.ndarray]:
        """Return time [s] and joint angles of the next state."""
        deadline = time.monotonic() + 20.0
        while time.monotonic() < deadline:
            self._reader.wait(0.1)
            odometry = self._reader.take_newest(1)
            if odometry is not None:
                p = deserialize_message(odometry[0], Odometry).pose.pose.position
                self.farthest = max(self.farthest, float(np.linalg.norm([p.x, p.y, p.z])))
            message = self._reader.take_newest(0)
            sample = self._codec.unpack(message[0]) if message else None
            if sample is not None and sample.position is not None:
                return sample.stamp_ns * 1e-9, np.array(sample.position)
        raise TimeoutError('no joint states for 20 s')

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._reader.destroy()


class Bench:
    """Processes of one case, ready to move."""

    def __init__(self, stack: ExitStack, node: Node, folder: Path, case: Case) -> None:
        config, robot = load_arm_config(), load_robot()
        loads = PlantParameters.nominal(config, robot).load_friction.tolist()
        world = {'seed': -1, 'pace': 'lockstep', **dict(case.sensors)}
        law: dict[str, object] = {
            'base_motion': case.base,
            'load_friction': loads,
            'path_tolerance': 10.0,
            'observer_gain': 0.0,
        }
        self.folder, self.node = folder, node
        if case.mass:
            drone = scaled(case.mass)
            world['drone_file'] = write(drone, folder / 'true.yaml')
            wrong = drone.with_errors(case.believed, case.believed)
            law['drone_file'] = write(wrong, folder / 'believed.yaml')
            flight = {'drone_file': law['drone_file']}
            self._start(stack, 'flight_control', flight)
        else:
            hanging = yaml.safe_load(resource('config', 'aerarm.yaml').read_text())
            hanging['gravity_in_base'] = [0.0, 0.0, 9.81]
            path = folder / 'arm.yaml'
            path.write_text(yaml.safe_dump(hanging))
            law['config'] = world['config'] = path
        if 'imu_delay' in world:
            law['imu_latency'] = 0.0  # the controller does not know
        deaf = () if case.hears_rotors else ('--ros-args', '-r', 'rotor_command:=unheard', '--')
        self.law = self._start(stack, 'computed_torque', law, deaf)
        self._start(stack, 'fake_hardware', world)
        self.listener = FlightListener(node)
        stack.callback(self.listener.destroy)
        topic = topics.JOINT_TRAJECTORY
        self.publisher = node.create_publisher(topic.type, topic.name, topic.qos)
        self.client = ArmClient(node)
        self.client.wait_for_mode(['idle'], 60.0)
        deadline = time.monotonic() + 60.0
        while not self.publisher.get_subscription_count():
            if self.law.returncode is not None:
                raise ValueError(self.law.tail(1))
            if time.monotonic() > deadline:
                raise TimeoutError(self.law.tail(3))
            time.sleep(0.05)
        if case.mass:
            self._wait_for_pilot()
        self.client.call('enable')
        self.client.wait_for_mode(['running'], 60.0)

    def _start(
        self, stack: ExitStack, name: str, values: dict, arguments: tuple[str, ...] = ()
    ) -> NodeProcess:
        log = self.folder / f'{name}.log'
        return stack.enter_context(NodeProcess(name, arguments, values, log=log))

    def _wait_for_pilot(self) -> None:
        """Wait until the flight controller answers, so that every run begins alike."""
        reader = RawReader(self.node, topics.ROTOR_COMMAND)
        deadline = time.monotonic() + 60.0
        while not (reader.wait(0.1) and reader.take_newest()):
            if time.monotonic() > deadline:
                raise TimeoutError('flight_control does not answer')
        reader.destroy()

    def move(self, motion: Oscillation) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] since the begin, and errors (M, n) [mrad]."""
        now, _ = self.listener.next()
        begin = round((now + LEAD) * 1e9)
        names = load_arm_config().joint_names
        self.publisher.publish(as_message(motion, names, begin))
        self.listener.farthest = 0.0
        samples = []
        while now < begin * 1e-9 + motion.duration:
            now, q = self.listener.next()
            samples.append((now - begin * 1e-9, q))
        self.client.wait_for_mode(['running'], 2.0)
        times = np.array([when for when, _ in samples])
        moving = (times > RAMP) & (times < motion.duration - RAMP)
        q = np.array([angles for _, angles in samples])[moving]
        return times[moving], 1e3 * (q - motion.evaluate(times[moving])[0])


def growth(times: np.ndarray, errors: np.ndarray) -> float:
    """Return the RMS of the last third over that of the first third."""
    first, last = np.quantile(times, [1 / 3, 2 / 3])
    parts = errors[times < first], errors[times > last]
    return float(np.sqrt((parts[1] ** 2).mean() / (parts[0] ** 2).mean()))


def run(case: Case, motions: list[str], seconds: float) -> dict[str, float]:
    """Print the lines of a case; return the RMS of each motion [mrad], infinite if it failed."""
    node = rclpy.create_node('free_base')
    result = dict.fromkeys(motions, np.inf)
    heading = (f'{case.mass:g} kg' if case.mass else 'fixed', case.base, case.variant)
    try:
        with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
            bench = Bench(stack, node, Path(folder), case)
            for name in motions:
                times, errors = bench.move(Oscillation(name, seconds))
                result[name] = float(np.sqrt((errors**2).mean()))
                figures = (
                    f'{result[name]:.2f}',
                    f'{np.abs(errors).max():.1f}',
                    f'{growth(times, errors):.2f}',
                    f'{1e3 * bench.listener.farthest:.0f}' if case.mass else '',
                )
                print(LINE.format(*heading, name, *figures), flush=True)
    except (ValueError, TimeoutError, ArmClientError) as error:
        print(LINE.format(*heading, '', '-', '-', '-', '-'), ' '.join(str(error).split())[:160])
    finally:
        node.destroy_node()
    return result


def variants(mass: float) -> list[Case]:
    """Return what may be wrong, for the free base and, beside it, an ignored one."""
    late = (('imu_delay', 0.01),)
    cheap = tuple(CHEAP.items())
    cases = []
    for base in ('none', 'free'):
        cases += [
            Case(mass, base, 'mass 20 % too large', 1.2),
            Case(mass, base, 'mass 20 % too small', 0.8),
            Case(mass, base, 'cheap IMU', sensors=cheap),
            Case(mass, base, 'IMU 10 ms late', sensors=late),
            Case(mass, base, 'no rotor commands', hears_rotors=False),
            Case(mass, base, 'all but the commands', 1.2, (*cheap, *late), False),
        ]
    return cases


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--masses', type=float, nargs='*', default=MASSES, help='of drones [kg]')
    parser.add_argument('--bases', nargs='*', default=BASES, help='values of base_motion')
    parser.add_argument('--motions', nargs='*', default=list(MOTIONS), choices=list(MOTIONS))
    parser.add_argument('--seconds', type=float, default=14.0, help='length of each motion')
    parser.add_argument('--variants', type=float, nargs='*', default=[1.3, 3.0],
                        help='masses for which things are wrong [kg]')  # fmt: skip
    options, _ = parser.parse_known_args()
    os.environ['ROS_DOMAIN_ID'] = str(1 + os.getpid() % 100)
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    rclpy.init(args=[])
    print(
        LINE.format(
            'drone', 'uses', 'what is wrong', 'arm', 'RMS [mrad]', 'max', 'growth', 'mm off'
        )
    )
    fixed = run(Case(0.0, 'none'), options.motions, options.seconds)
    cases = [Case(mass, base) for mass in options.masses for base in options.bases]
    cases += [case for mass in options.variants for case in variants(mass)]
    worst = 0.0
    for case in cases:
        errors = run(case, options.motions, options.seconds)
        if case.base == 'free' and case.variant == Case.variant:
            worst = max(worst, *(errors[name] / fixed[name] for name in options.motions))
    print(f'Free base over fixed base, at most: {worst:.2f} (goal: 1.3 with a true drone file).')
    rclpy.shutdown()


if __name__ == '__main__':
    main()
