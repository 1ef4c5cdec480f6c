"""Stick-slip of joints in slow motion, without and with compensation of the identified friction.

The emulated arm has Stribeck friction (`ArmPlant`, a constraint of the physics engine). Its model
is identified from a bag of its motion. Then `ComputedTorque` moves each joint at 0.02 rad/s in both
directions and holds it. The friction is not compensated, compensated by the identified viscous, dry
and load-dependent friction, or by all identified terms. The last row adds the observer.
"""

import argparse
import sys
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from payload_hours import CYCLE
from touching.touched_arm import Sensors, TouchedPlant, controller, identified, made

from aerarm_ros.control.base.moving_base_dynamics import MovingBaseDynamics
from aerarm_ros.control.compensation import FrictionCompensation
from aerarm_ros.motion.signals import JointReference
from aerarm_ros.online.joint_friction import JointFriction
from aerarm_ros.online.replay import KnownArm
from aerarm_ros.simulation.arm_plant import PlantParameters

SPEED = 0.02  # [rad/s]
RISE, CREEP, HOLD = 0.2, 10.0, 3.0  # [s]
START = np.array([0.3, 0.9, -0.4, 0.6])
RESTING = 0.1  # of the speed, below which a joint sticks
NONE, DRY, ALL = 'none', 'viscous, dry and load-dependent', 'all identified terms'

Array = np.ndarray


class Creep:
    """Motion at constant speed in both directions, followed by a rest."""

    def __init__(self) -> None:
        pace = np.array([0.0, SPEED, SPEED, -SPEED, -SPEED, 0.0, 0.0])
        lengths = [RISE, CREEP, 2.0 * RISE, CREEP, RISE, HOLD]
        self.ends = np.concatenate([[0.0], np.cumsum(lengths)])
        self._pace = pace

    def take_over(self, q: Array) -> None:
        """Start at a posture."""
        self._q, self.reference = np.array(q), JointReference.at_rest(q)
        self._begin: float | None = None

    def update(self, q: Array, now: float, dt: float) -> JointReference:
        """Return the reference of `now` [s]."""
        self._begin = now if self._begin is None else self._begin
        speed = float(np.interp(now - self._begin, self.ends, self._pace))
        change = (speed - self.reference.dq) / dt if dt else 0.0 * self._q
        self._q = self._q + dt * speed
        self.reference = JointReference(self._q, speed + 0.0 * self._q, change)
        return self.reference


class Result(NamedTuple):
    """RMS and largest error, largest stick-slip step and motion at rest of each joint (n,)."""

    rms: Array
    largest: Array
    stair: Array
    held: Array  # [rad] peak to peak in the last two seconds


def run(truth: PlantParameters, known: KnownArm, compensation: str, observed: float) -> Result:
    """Move slowly with one kind of friction compensation, and return the errors."""
    arm, _ = made(4, 0)
    viscous, coulomb, share = known.friction
    friction: FrictionCompensation | None = None
    if compensation == DRY:
        friction = FrictionCompensation(viscous, coulomb, 0.002, load_share=share)
    elif compensation == ALL:
        friction = JointFriction(known, 0.002)
    source = Creep()
    loop, _ = controller(known, source, friction, observed)
    plant = TouchedPlant(arm.robot, truth, START)
    sensors = Sensors(arm, START, np.random.default_rng(0))
    state, now, rows = sensors.measure(START, np.zeros(4)), 0.0, []
    while now < source.ends[-1]:
        command = loop.update(state, now)
        effort = np.zeros(4) if command is None or command.tau is None else command.tau
        if command is None:  # control begins with the second state
            effort = MovingBaseDynamics(known.robot).gravity(START)
        plant.apply_effort(effort)
        plant.advance(CYCLE)  # Stribeck friction follows the velocity in every sub-step
        now += CYCLE
        state = sensors.measure(plant.position, effort)
        rows.append([source.reference.q, plant.position, plant.velocity])
    return judged(np.array(rows), source.ends)


def judged(rows: Array, ends: Array) -> Result:
    """Return the errors of a run; rows are reference, position and velocity (k, 3, n)."""
    time = CYCLE * np.arange(1, len(rows) + 1)
    creeps = (time > 1.0) & (time < ends[5])
    wanted, q, dq = rows.transpose(1, 0, 2)
    error = (q - wanted)[creeps]
    held = np.ptp(q[time > ends[-1] - 2.0], axis=0)
    ways = [(time > ends[k] + 0.5) & (time < ends[k + 1]) for k in (1, 3)]
    stairs = [
        max(stair(q[way, joint], dq[way, joint]) for way in ways) for joint in range(q.shape[1])
    ]
    rms = np.sqrt(np.mean(error**2, axis=0))
    return Result(rms, np.abs(error).max(axis=0), np.array(stairs), held)


def stair(q: Array, dq: Array) -> float:
    """Return the largest motion [rad] between two rests of at least 20 ms; 0 without two rests."""
    sticks = np.abs(dq) < RESTING * SPEED
    edges = np.flatnonzero(np.diff(np.concatenate([[0], sticks.astype(int), [0]])))
    rests = [(a, b) for a, b in edges.reshape(-1, 2) if b - a >= 20]
    ways = [abs(q[after] - q[before - 1]) for (_, before), (after, _) in pairwise(rests)]
    return max(ways, default=0.0)


def main() -> int:
    """Identify the arm, move it slowly, and print the table of errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seed', type=int, default=1, help='seed of the emulated arm')
    parser.add_argument(
        '--stribeck', type=float, default=0.5, help='static minus Coulomb friction, over Coulomb'
    )
    parser.add_argument('--velocity', type=float, default=0.05, help='Stribeck velocity [rad/s]')
    options = parser.parse_args()
    arm, drawn = made(4, options.seed)
    truth = replace(drawn, stribeck=options.stribeck, stribeck_velocity=options.velocity)
    known, _ = identified(arm, truth, options.seed)
    print(
        '| compensation | RMS error of joints 1 to 4 [mrad] | largest error [mrad] '
        '| largest stick-slip step [mrad] | motion while holding [mrad] |'
    )
    print('|---|---|---|---|---|')
    for name, observed in ((NONE, 0.0), (DRY, 0.0), (ALL, 0.0), (ALL, 0.2)):
        result = run(truth, known, name, observed)
        cells = [', '.join(f'{1e3 * value:.2f}' for value in row) for row in result]
        label = f'{name}, and the observed disturbance' if observed else name
        print(f'| {label} | {" | ".join(cells)} |', flush=True)
    return 0


if __name__ == '__main__':
    sys.exit(main())
