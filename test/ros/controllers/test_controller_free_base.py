"""A controller on a free base: its requirements, rejections and rotor commands."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
import rclpy
import yaml
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_ros.control.base.free_base_estimator import FreeBaseEstimator
from aerarm_ros.description.resources import resource
from aerarm_ros.hardware.bridge_modes import COMMANDABLE
from aerarm_ros.nodes.controllers.computed_torque import ComputedTorqueNode
from aerarm_ros.nodes.controllers.kinematic_control import KinematicControlNode
from aerarm_ros.ros.controllers.controller_node import ControllerNode
from aerarm_ros.ros.controllers.controller_parameters import PAYLOAD

DRONE = str(resource('config', 'drone.yaml'))
LIMIT = 20.0  # [s]
LOAD = [1.0, 0.1, 0.0, 0.0, 1e-3, 0.0, 0.011, 0.0, 0.0, 0.011]  # 1 kg in the gripper


@pytest.fixture
def make(ros_domain: dict[str, str]) -> Iterator[Callable[..., ControllerNode]]:
    """Return a function that makes a controller with parameters."""
    with ExitStack() as stack:

        def make(
            kind: type[ControllerNode] = ComputedTorqueNode, **parameters: object
        ) -> ControllerNode:
            given = [word for name, x in parameters.items() for word in ('-p', f'{name}:={x}')]
            rclpy.init(args=['--ros-args', *given])
            stack.callback(rclpy.shutdown)
            node = kind()
            stack.callback(node.close)
            return node

        yield make


def test_free_needs_a_drone(make) -> None:
    with pytest.raises(ValueError, match='set drone_file'):
        make(base_motion='free')


def test_full_is_refused_on_a_drone_that_would_excite_itself(make) -> None:
    with pytest.raises(ValueError, match=r"hexarotor \(3 kg\) is unstable.*use 'free'"):
        make(base_motion='full', drone_file=DRONE)


@pytest.fixture
def heavy_drone(tmp_path: Path) -> str:
    """Return the file of a drone of 20 kg, which bears `full` with the arm alone."""
    drone = yaml.safe_load(Path(DRONE).read_text())
    drone['mass'] *= 20.0 / 3.0
    drone['inertia'] = [value * (20.0 / 3.0) ** (5.0 / 3.0) for value in drone['inertia']]
    for rotor in drone['rotors']:
        rotor['thrust_max'] *= 20.0 / 3.0
    path = tmp_path / 'heavy.yaml'
    path.write_text(yaml.safe_dump(drone))
    return str(path)


def test_full_is_refused_with_a_payload_by_which_it_would_excite_itself(make, heavy_drone) -> None:
    with pytest.raises(ValueError, match='is unstable'):
        make(base_motion='full', drone_file=heavy_drone, **{PAYLOAD: LOAD})


def test_an_unstable_payload_is_rejected_at_run_time(make, heavy_drone) -> None:
    node = make(base_motion='full', drone_file=heavy_drone).node
    (result,) = node.set_parameters([Parameter(PAYLOAD, value=LOAD)])
    assert 'is unstable' in result.reason
    (result,) = node.set_parameters([Parameter(PAYLOAD, value=[0.02 * x for x in LOAD])])
    assert result.successful, result.reason


def test_without_base_motion_there_is_no_warning_about_it(make) -> None:
    node = make(KinematicControlNode, base_motion='free', drone_file=DRONE)
    node._mode = COMMANDABLE[0]
    assert node.warning() == ''
    assert node.describe()['base motion'].startswith('not used')


def hear(node: ComputedTorqueNode, send: Callable[[], None], done: Callable[[], bool]) -> None:
    deadline = time.monotonic() + LIMIT
    while not done():
        assert time.monotonic() < deadline
        send()
        if node._stream.wait(0.05):
            node._take()


def rotor_command(names: tuple[str, ...], stamp_ns: int, thrust: list[float]) -> JointState:
    message = JointState(name=list(names), effort=thrust)
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    return message


def test_rotor_commands_are_used_and_those_of_other_drones_rejected(make) -> None:
    node = make(base_motion='free', drone_file=DRONE)
    base, names = node.base, node.arm.drone.rotor_names
    assert isinstance(base, FreeBaseEstimator)
    assert node.describe()['base motion'].startswith('neither rotor commands nor IMU')
    assert node.describe()['compensated delay [ms]'] == pytest.approx(5.8, abs=0.1)
    np.testing.assert_allclose(base.configured.gravity, [0.0, 0.0, 9.81], atol=1e-9)
    teller: Node = node.node
    topic = topics.ROTOR_COMMAND
    publisher = teller.create_publisher(topic.type, topic.name, topic.qos)
    stamps = iter(range(1, 10**9))

    def tell(sent: tuple[str, ...], thrust: list[float]) -> Callable[[], None]:
        return lambda: publisher.publish(rotor_command(sent, 1_000_000 * next(stamps), thrust))

    thrusts = [float(7 + k) for k in range(len(names))]
    hear(node, tell(names, thrusts), lambda: base.rotors.commanded_force > 0.0)
    np.testing.assert_allclose(base.rotors.thrust(node.stamp_ns * 1e-9), thrusts)
    for sent, thrust, reason in (
        (names[:4], thrusts[:4], 'describes this drone'),
        (names, [float('nan'), *thrusts[1:]], 'NaN'),
        (names, [], 'effort is empty'),
    ):
        hear(node, tell(sent, thrust), lambda r=reason: r in node.diagnostics.last_rejection)


def test_a_payload_reaches_every_model(make) -> None:
    node = make(base_motion='free', drone_file=DRONE)
    mass = node.base.whole.mass
    node.arm.carry([0.2, 0.02, 0.0, 0.0, 1e-4, 0.0, 2.1e-3, 0.0, 0.0, 2.1e-3])
    assert node.base.whole.mass == pytest.approx(mass + 0.2)
    law, governor = [model for model in node.arm._models if model is not node.base.whole]
    assert law.whole.mass == pytest.approx(mass + 0.2)
    assert governor.mass == pytest.approx(mass + 0.2)
