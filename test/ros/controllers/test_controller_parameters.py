"""Parameters of controllers, at their start and while they run, in this process."""

import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
import yaml
from controller_bench import NAMES, trajectory
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from aerarm_msgs_py import topics
from aerarm_ros.control.base.free_base_estimator import FreeBaseEstimator
from aerarm_ros.control.checks import RejectedInputError
from aerarm_ros.description.resources import resource
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.bridge_modes import COMMANDABLE
from aerarm_ros.motion.signals import ArmState
from aerarm_ros.nodes.controllers.computed_torque import ComputedTorqueNode
from aerarm_ros.nodes.controllers.gravity_compensation import GravityCompensationNode
from aerarm_ros.nodes.controllers.impedance_control import ImpedanceControlNode
from aerarm_ros.nodes.controllers.kinematic_control import KinematicControlNode
from aerarm_ros.ros.controllers.controller_node import ControllerNode
from aerarm_ros.ros.controllers.controller_parameters import PAYLOAD, ControlledArm
from aerarm_ros.ros.controllers.tool_topics import TARGET_PARAMETERS, make_target_follower
from aerarm_ros.ros.parameters.shared_parameters import ARM_FILES

CYCLE = 1e-3
DRONE = str(resource('config', 'drone.yaml'))
LIMIT = 20.0  # [s]
UPRIGHT = np.array([0.0, np.pi / 2, 0.0, 0.0])
REST = ArmState(UPRIGHT, np.zeros(4), np.zeros(4))
BALL = [0.2, 0.02, 0.0, 0.0, 1e-4, 0.0, 2.1e-3, 0.0, 0.0, 2.1e-3]
LOAD = [1.0, 0.1, 0.0, 0.0, 1e-3, 0.0, 0.011, 0.0, 0.0, 0.011]  # 1 kg in the gripper


def act(node: ControllerNode, now: float = 0.0) -> None:
    """Run the waiting actions of the loop's thread."""
    while node._requests:
        node._requests.popleft()(now)


def change(node: ControllerNode, name: str, value: object) -> str:
    """Set a parameter; return why it was rejected."""
    (result,) = node.node.set_parameters([Parameter(name, value=value)])
    act(node)
    return result.reason


@pytest.mark.parametrize(
    ('kind', 'parameters', 'name', 'values', 'reason'),
    [
        (ComputedTorqueNode, {}, 'kp', [1.0, 2.0], '2 values, 4 are needed'),
        (ComputedTorqueNode, {'feedback': 'boards'}, 'kd', [30.0], 'gains of the bridge'),
        (GravityCompensationNode, {}, 'kd', [1.0] * 5, '5 values, 4 are needed'),
        (ImpedanceControlNode, {}, 'stiffness', [1.0] * 4, '4 values, 3 are needed'),
    ],
)
def test_gains_that_do_not_fit_are_refused(
    make_node, kind, parameters, name, values, reason
) -> None:
    node = make_node(kind, **parameters)
    before = node.node.get_parameter(name).value
    assert reason in change(node, name, values)
    assert node.node.get_parameter(name).value == before
    if kind is ComputedTorqueNode and not parameters:
        assert change(node, 'kp', [100.0]) == ''
        np.testing.assert_array_equal(node.law.kp, np.full(4, 100.0))


def play(node: GravityCompensationNode, state: ArmState, start: float, cycles: int) -> np.ndarray:
    """Answer the same state for some cycles; return the efforts (cycles, n) [Nm]."""
    efforts = []
    for cycle in range(cycles):
        now = start + cycle * CYCLE
        act(node, now)
        node.before_update(state, now)
        command = node.loop.update(state, now)
        efforts.append(np.full(4, np.nan) if command is None else command.tau)
    return np.array(efforts)


def test_hand_guiding_comes_and_goes_without_a_step(make_node) -> None:
    node = make_node(GravityCompensationNode, observer_gain=0.0)
    play(node, REST, 0.0, 10)
    pushed = REST._replace(q=UPRIGHT + 0.05)
    efforts = [play(node, pushed, 0.01, 10)]
    assert change(node, 'hand_guiding', True) == ''
    efforts.append(play(node, pushed, 0.02, 1000))
    assert change(node, 'hand_guiding', False) == ''
    efforts.append(play(node, pushed, 1.02, 1000))
    effort = np.vstack(efforts)
    assert np.abs(effort[0] - effort[-1]).max() > 1.0
    assert np.abs(np.diff(effort, axis=0)).max() < 0.02
    # It holds where it was let go.
    np.testing.assert_allclose(node.follower.reference.q, pushed.q)


def test_references_are_rejected_during_hand_guiding(make_node, monkeypatch) -> None:
    acts = {}
    monkeypatch.setattr(
        ControllerNode, 'listen', lambda self, topic, act: acts.update({topic.name: act})
    )
    node = make_node(GravityCompensationNode, hand_guiding=True)
    node._mode = 'running'
    for name, message in (
        ('set_point', JointState(name=NAMES)),
        ('joint_trajectory', trajectory(list(UPRIGHT), 1.0)),
    ):
        with pytest.raises(RejectedInputError, match='hand_guiding'):
            acts[name](message, 0.0)
    assert node.ahead(np.zeros(1)) is None


# Payload and friction.


def weight(node: ComputedTorqueNode) -> np.ndarray:
    """Return the torque [Nm] of the payload at rest in the node's model."""
    model = node.arm._models[0]
    alone = node.arm.dynamics(node.values)
    alone.carry(np.zeros(10))
    node.arm._models.remove(alone)
    q = UPRIGHT + [0.0, 0.0, 0.0, 1.0]
    return model.gravity(q) - alone.gravity(q)


def test_a_payload_may_change_and_an_impossible_one_changes_nothing(make_node) -> None:
    node = make_node(ComputedTorqueNode, **{PAYLOAD: BALL})
    full = weight(node)
    assert np.abs(full).max() > 0.1
    for values in ([-1.0, *BALL[1:]], BALL[:4]):
        assert 'no body has these inertial parameters' in change(node, PAYLOAD, values)
    np.testing.assert_allclose(weight(node), full, atol=1e-9)
    assert change(node, PAYLOAD, [0.5 * value for value in BALL]) == ''
    np.testing.assert_allclose(weight(node), 0.5 * full, atol=1e-9)


def test_the_stribeck_friction_of_friction_file_is_compensated(make_node, tmp_path: Path) -> None:
    """A URDF cannot contain this friction."""
    robot, width = load_robot(), 0.2
    friction = {
        'viscous': robot.viscous,
        'coulomb': robot.coulomb,
        'stribeck': robot.coulomb,
        'stribeck_width': np.full(4, width),
    }
    parameters = {
        'joint_names': list(robot.joint_names),
        'inertial_parameters': robot.inertial_parameters.ravel().tolist(),
        'friction': {name: values.tolist() for name, values in friction.items()},
    }
    file = tmp_path / 'estimate.yaml'
    file.write_text(yaml.safe_dump({'/**': {'ros__parameters': parameters}}))
    node = make_node(ComputedTorqueNode, friction_file=file)
    plain = node.arm.friction(SimpleNamespace(**vars(node.values) | {'friction_file': ''}))
    complete = node.law._friction
    # Well above the width of the smoothed sign; the Stribeck part falls to 1/e at its own width.
    slow, fast = (complete.torque(np.full(4, v)) - plain.torque(np.full(4, v)) for v in (0.1, 1.0))
    falls = np.exp(-((0.1 / width) ** 2))
    np.testing.assert_allclose(slow, falls * robot.coulomb, rtol=0.3)
    assert np.abs(fast).max() < 0.02 * slow.min()


# Base motion.


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


def test_a_base_motion_that_the_drone_does_not_bear_is_rejected(make_node, heavy_drone) -> None:
    full = {'base_motion': 'full', 'drone_file': heavy_drone}
    for given, reason in (
        ({'base_motion': 'free'}, 'set drone_file'),
        ({**full, 'drone_file': DRONE}, r"hexarotor \(3 kg\) is unstable.*use 'free'"),
        ({**full, PAYLOAD: LOAD}, 'is unstable'),
    ):
        with pytest.raises(ValueError, match=reason):
            make_node(ComputedTorqueNode, **given)
        rclpy.shutdown()
    node = make_node(ComputedTorqueNode, **full)
    assert 'is unstable' in change(node, PAYLOAD, LOAD)
    assert change(node, PAYLOAD, [0.02 * x for x in LOAD]) == ''


def test_without_base_motion_there_is_no_warning_about_it(make_node) -> None:
    node = make_node(KinematicControlNode, base_motion='free', drone_file=DRONE)
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


def test_rotor_commands_are_used_and_those_of_other_drones_rejected(make_node) -> None:
    node = make_node(ComputedTorqueNode, base_motion='free', drone_file=DRONE)
    base, names = node.base, node.arm.drone.rotor_names
    assert isinstance(base, FreeBaseEstimator)
    assert node.describe()['base motion'].startswith('neither rotor commands nor IMU')
    np.testing.assert_allclose(base.configured.gravity, [0.0, 0.0, 9.81], atol=1e-9)
    topic = topics.ROTOR_COMMAND
    publisher = node.node.create_publisher(topic.type, topic.name, topic.qos)
    stamps = iter(range(1, 10**9))

    def tell(sent: tuple[str, ...], thrust: list[float]) -> Callable[[], None]:
        def send() -> None:
            message = JointState(name=list(sent), effort=thrust)
            message.header.stamp.nanosec = 1_000_000 * next(stamps)
            publisher.publish(message)

        return send

    thrusts = [float(7 + k) for k in range(len(names))]
    hear(node, tell(names, thrusts), lambda: base.rotors.commanded_force > 0.0)
    np.testing.assert_allclose(base.rotors.thrust(node.stamp_ns * 1e-9), thrusts)
    for sent, thrust, reason in (
        (names[:4], thrusts[:4], 'describes this drone'),
        (names, [float('nan'), *thrusts[1:]], 'NaN'),
        (names, [], 'effort is empty'),
    ):
        hear(node, tell(sent, thrust), lambda r=reason: r in node.diagnostics.last_rejection)
    # A payload reaches every model: law, base and governor.
    mass = base.whole.mass
    node.arm.carry(BALL)
    law, governor = [model for model in node.arm._models if model is not base.whole]
    for model in (base.whole, law.whole, governor):
        assert model.mass == pytest.approx(mass + 0.2)


DEFAULTS = {parameter.name: parameter.default for parameter in (*ARM_FILES, *TARGET_PARAMETERS)}


@pytest.mark.parametrize(
    ('prefix', 'frame', 'reach'),
    [('', 'tool0', 0.917), ('', 'wrist', 0.817), ('left_', 'tool0', 0.917), ('l', 'ltool0', 0.917)],
)
def test_targets_beyond_the_stretched_arm_are_refused_whatever_the_prefix(
    prefix: str, frame: str, reach: float
) -> None:
    values = SimpleNamespace(**DEFAULTS | {'tf_prefix': prefix, 'frame': frame, 'drone_file': ''})
    follower = make_target_follower(values, ControlledArm.from_parameters(values))
    follower.take_over(UPRIGHT)
    follower.set_target([0.0, 0.0, reach - 0.001], 0.0)
    with pytest.raises(RejectedInputError):
        follower.set_target([0.0, 0.0, reach + 0.001], 0.0)
