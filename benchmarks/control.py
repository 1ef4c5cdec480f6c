"""Computing time of one update of each control law, compared with single Pinocchio calls."""

import argparse
from collections.abc import Callable
from itertools import count
from time import perf_counter_ns
from typing import Any

import numpy as np
import pinocchio as pin

from aerarm_ros.control.base.base_motion import BaseMotion, ImuSample, Mount
from aerarm_ros.control.base.base_motion_estimator import BaseMotionEstimator
from aerarm_ros.control.base.free_base_estimator import FreeBaseEstimator, FreeBaseMotion
from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.base.rotor_wrench import RotorWrench, carrier_parameters
from aerarm_ros.control.checks import JointLimits
from aerarm_ros.control.compensation import FrictionCompensation, MomentumObserver
from aerarm_ros.control.control_loop import ControlLoop
from aerarm_ros.control.laws.cartesian_impedance import CartesianImpedance
from aerarm_ros.control.laws.computed_torque import BoardComputedTorque, ComputedTorque
from aerarm_ros.control.laws.gravity_compensation import GravityCompensation
from aerarm_ros.control.laws.kinematic_control import (
    CartesianMotionControl,
    DampedInverse,
    JointMotionControl,
    VelocityResolution,
)
from aerarm_ros.control.references.trajectory_follower import FollowerTolerances, TrajectoryFollower
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drone_config import load_drone_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.model.kinematics import Kinematics
from aerarm_ros.model.whole_body_dynamics import WholeBodyDynamics
from aerarm_ros.motion.signals import ArmState, JointReference, TaskReference

UPDATES = 5000
CYCLE = 1e-3
Q, DQ, DDQ = np.random.default_rng(0).uniform(-0.5, 0.5, (3, 4)) + [[0.0, 1.2, 0.0, 0.5]] * 3
BUDGET = 30.0  # [us] for a control update with RNEA
IMU_CYCLES = 4  # 250 Hz
FREE_GOAL = 2.0  # largest ratio to the law on a fixed base


def measure(call: Callable[[], Any]) -> tuple[float, float]:
    """Return median and p99 of a call's duration [us]."""
    for _ in range(200):
        call()
    times = np.empty(UPDATES)
    for index in range(UPDATES):
        start = perf_counter_ns()
        call()
        times[index] = perf_counter_ns() - start
    p50, p99 = np.percentile(times, [50, 99]) * 1e-3
    return float(p50), float(p99)


def bare_calls() -> dict[str, Callable[[], Any]]:
    model = load_robot().model
    data = model.createData()
    frame = model.getFrameId('tool0')
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    return {
        'rnea': lambda: pin.rnea(model, data, Q, DQ, DDQ),
        'crba': lambda: pin.crba(model, data, Q),
        'computeCoriolisMatrix': lambda: pin.computeCoriolisMatrix(model, data, Q, DQ),
        'computeFrameJacobian': lambda: pin.computeFrameJacobian(model, data, Q, frame, aligned),
    }


def laws() -> dict[str, Callable[[], Any]]:
    config, robot = load_arm_config(), load_robot()
    carrier = carrier_parameters(load_drone_config())
    dynamics = MovingBaseDynamics(robot, config.column('reflected_inertia'), carrier)
    friction = FrictionCompensation(robot.viscous, robot.coulomb, load_share=0.04)
    limits, kinematics = JointLimits.from_config(config), Kinematics(robot)
    resolution = VelocityResolution(kinematics, limits, config.rest_position, DampedInverse())
    state = ArmState(Q, DQ, dynamics.inverse(Q, DQ, DDQ))
    joints = JointReference(Q + 0.01, DQ, DDQ)
    task = TaskReference(kinematics.position(Q) + 0.01, np.zeros(3), np.zeros(3))
    base = BaseMotion(np.array([0.0, 0.0, -9.81]), np.array([1.0, 2.0, 9.0]), DQ[:3], DDQ[:3])
    free = FreeBaseMotion(base, np.ones(6), np.ones(6))
    gravity = GravityCompensation(dynamics, 60.0, 3.0, friction)
    torque = ComputedTorque(dynamics, 400.0, 40.0, friction=friction)
    boards = BoardComputedTorque(dynamics, friction=friction)
    impedance = CartesianImpedance(dynamics, kinematics, 300.0, 40.0, config.rest_position)
    observer = MomentumObserver(dynamics, 30.0, friction)
    joint_motion = JointMotionControl(resolution, 8.0)
    joint_motion.take_over(Q)
    cartesian_motion = CartesianMotionControl(resolution, 8.0)
    level = np.array([0.0, 0.0, 0.0, 1.0])
    imu = BaseMotionEstimator([0.0, 0.0, -9.81])
    imu.offer(ImuSample(0.0, level, DQ[:3], np.array([0.0, 0.0, 9.81])), 0.0)
    return {
        'gravity compensation (2.14)': lambda: gravity.update(state, joints, CYCLE),
        'computed torque (2.21)': lambda: torque.update(state, joints, CYCLE),
        'computed torque, moving base': lambda: torque.update(state, joints, CYCLE, base),
        'gravity comp., free base': lambda: gravity.update(state, joints, CYCLE, free),
        'computed torque, free base': lambda: torque.update(state, joints, CYCLE, free),
        'computed torque, on boards': lambda: boards.update(state, joints, CYCLE),
        'Cartesian impedance': lambda: impedance.update(state, task, CYCLE),
        'momentum observer': lambda: observer.update(state, CYCLE),
        'kinematic, joint (2.5.2)': lambda: joint_motion.update(state, task, CYCLE),
        'kinematic, Cartesian (2.5.3)': lambda: cartesian_motion.update(state, task, CYCLE),
        'base motion from the IMU': lambda: imu.motion(0.003),
        'base reaction': lambda: dynamics.reaction(Q, DQ, DDQ, base),
    }


def whole_loops() -> dict[str, Callable[[], Any]]:
    """Return updates of a node's complete loop: trajectory, law, limits and observer."""
    config, robot = load_arm_config(), load_robot()
    calls = {}
    for name, gain in (('loop: trajectory, computed torque', 0.0), ('  and observer', 30.0)):
        dynamics = MovingBaseDynamics(robot, config.column('reflected_inertia'))
        friction = FrictionCompensation(robot.viscous, robot.coulomb)
        law = ComputedTorque(dynamics, 400.0, 40.0, friction=friction)
        observer = MomentumObserver(dynamics, gain, friction) if gain else None
        calls[name] = endless_motion(law, observer, compensation_max=gain / 30.0)
    return calls


def endless_motion(
    law: ComputedTorque, *parts: Any, hear: Callable[[float], Any] = lambda _: None, **more: Any
) -> Callable[[], Any]:
    """Return the update of a control loop whose arm always moves; `parts` and `more` are its."""
    limits = JointLimits.from_config(load_arm_config())
    follower = TrajectoryFollower(limits, FollowerTolerances.uniform(4, path=10.0))
    loop = ControlLoop(limits, follower, law, *parts, **more)
    state, times = ArmState(Q, DQ, np.zeros(4)), count()

    def update() -> None:
        now = CYCLE * next(times)
        hear(now)
        if follower.status == 'holding':
            goal = Q + 0.5 if follower.reference.q[0] < Q[0] + 0.2 else Q
            follower.go_to(np.clip(goal, limits.position_min, limits.position_max), now)
        loop.update(state, now)

    return update


def free_over_fixed() -> tuple[float, float]:
    """Return computing times of computed torque on a free base, relative to a fixed base.

    The first ratio is that of the control law, the second that of the whole cycle. The cycle
    includes the inputs of the law: IMU samples and rotor commands at 250 Hz, and their comparison
    with the model.
    """
    config, robot, drone = load_arm_config(), load_robot(), load_drone_config()
    rotors, carrier = config.column('reflected_inertia'), carrier_parameters(drone)
    friction = FrictionCompensation(robot.viscous, robot.coulomb)
    dynamics = MovingBaseDynamics(robot, rotors, carrier)
    law = ComputedTorque(dynamics, 400.0, 40.0, friction=friction)
    state, joints = ArmState(Q, DQ, np.zeros(4)), JointReference(Q + 0.01, DQ, DDQ)
    free = FreeBaseMotion(dynamics.still, np.ones(6), np.ones(6))
    whole = WholeBodyDynamics(robot, rotors, carrier)
    gravity = drone.gravity_in_base
    base = FreeBaseEstimator(gravity, RotorWrench(drone), whole, Mount.from_drone(drone))
    random, cycles = np.random.default_rng(0), count(1)

    def hear(now: float) -> None:
        """Pass an IMU sample and a command of a hovering drone to the estimator, at 250 Hz."""
        if next(cycles) % IMU_CYCLES:
            return
        noise = 1e-3 * random.standard_normal((3, 3))
        up, level = np.array([0.0, 0.0, 9.81]), np.array([0.0, 0.0, 0.0, 1.0])
        base.offer(ImuSample(now, level, noise[0], up + noise[1]), now)
        thrust = 9.81 * whole.mass / drone.n + np.resize(noise[2], drone.n)
        base.rotors.offer(drone.rotor_names, thrust, now, now)

    laws = _over(
        lambda: law.update(state, joints, CYCLE), lambda: law.update(state, joints, CYCLE, free)
    )
    return laws, _over(endless_motion(law), endless_motion(law, base=base, hear=hear))


def _over(first: Callable[[], Any], second: Callable[[], Any]) -> float:
    """Return the ratio of the mean durations of two calls, measured alternately."""
    ratios = []
    for _ in range(200):
        times = []
        for call in (first, second):
            start = perf_counter_ns()
            for _ in range(4 * IMU_CYCLES):
                call()
            times.append(perf_counter_ns() - start)
        ratios.append(times[1] / times[0])
    return float(np.median(ratios))


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    print(f'{"one update, n = 4":36} {"p50 [us]":>9} {"p99 [us]":>9}')
    for calls in (bare_calls(), laws(), whole_loops()):
        for name, call in calls.items():
            p50, p99 = measure(call)
            print(f'{name:36} {p50:9.1f} {p99:9.1f}')
    print(f'Budget of a control update with RNEA: {BUDGET:g} us.')
    law, cycle = free_over_fixed()
    print('Computing time of computed torque on a free base relative to a fixed base: '
          f'law {law:.2f} (goal {FREE_GOAL:g}), whole cycle {cycle:.2f}')  # fmt: skip


if __name__ == '__main__':
    main()
