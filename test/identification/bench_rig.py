"""The motor bench on the emulated arm, in simulation time."""

from collections.abc import Sequence
from itertools import takewhile

import numpy as np
from emulated_arm import EmulatedArm

from aerarm_ros.description.arm_config import ArmConfig
from aerarm_ros.description.robot import Robot
from aerarm_ros.excitation.bench_motion import BenchMotion, BenchPlan, split
from aerarm_ros.excitation.settings import MotionLimits
from aerarm_ros.excitation.trajectory import MotionSequence, Stage, transfer
from aerarm_ros.identification.motor_bench.motor_friction import MotorRun, MotorSupply
from aerarm_ros.simulation.arm_plant import PlantParameters


def measure(
    config: ArmConfig,
    robot: Robot,
    truth: PlantParameters,
    joint: int,
    posture: Sequence[float],
    plan: BenchPlan,
    swings_only: bool = False,
) -> tuple[list[MotorRun], MotorSupply]:
    """Return the runs of one joint and its motor's data, measured through the boards' frames."""
    arm = EmulatedArm(config, robot, truth, np.array(posture))
    motion = BenchMotion(plan, MotionLimits.of_arm(config), arm.posture, np.array(posture), [joint])
    sequence, measurements, begin = motion.sequence, motion.measurements, 0.0
    if swings_only:  # of a plan that also has steps
        measurements = [measurement for measurement in measurements if measurement.swings]
        (index,) = (i for i, stage in enumerate(sequence.stages) if 'swings' in stage.name)
        swings, begin = sequence.stages[index], sequence.boundaries[index]
        way = transfer(arm.posture, swings.motion.evaluate(0.0).q, 0.5)
        sequence, begin = MotionSequence([Stage('transfer', way), swings]), begin - way.duration
    fields = ('q', 'dq', 'tau', 'current', 'speed', 'power')
    end = measurements[-1].end
    rows = [
        (1e-9 * state.stamp_ns, state.path_time, *(getattr(state, f)[joint] for f in fields))
        for state in takewhile(lambda state: begin + state.path_time <= end, arm.play(sequence))
    ]
    time, path_time, q, dq, tau, *motor = np.array(rows).T
    path_time += begin
    runs = [
        MotorRun(
            measurement.speed, path_time[part], q[part], dq[part], tau[part], measurement.swings
        )
        for measurement, part in split(measurements, path_time)
    ]
    return runs, MotorSupply(time, *motor)
