"""Time for which each joint can hold its largest load, and braking energy returned to the supply.

Usage: python benchmarks/heat.py

Starting with cold motors, each joint holds the largest load of the arm with its rated payload, over
all base orientations. The joint continues to hold when its torque limit is reduced, like a barrier
at a limit. The seeds produce emulated motors that deviate from the configuration. The braking
energy is that of the largest inertia at full speed, without losses in windings and friction.
"""

from __future__ import annotations

import argparse
from math import inf, sqrt

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.drive_config import JointConfig
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.emulation.emulated_motor import CRITICAL, EmulatedHeat
from aerarm_ros.hardware.gate.joint_barrier import JointLoads
from aerarm_ros.hardware.heat_watch import ThermalLimit

STEP = 0.1  # [s]
LONGEST = 600.0  # [s]
SEEDS = range(4)
VOLTAGE = 24.0
CAPACITANCES = (1e-3, 1e-2)  # [F]
EVENTS = ('warning', 'reduced', 'below load', 'stop', 'board error')


def times(joint: JointConfig, load: float, seed: int) -> tuple[dict[str, float], float]:
    """Return the time of each event [s], and the largest error until the stop [K]."""
    true, limit = EmulatedHeat(joint.motor, seed), ThermalLimit(joint, 25.0, 25.0)
    current, error = load / joint.torque_per_ampere, 0.0
    found = dict.fromkeys(EVENTS, inf)
    for step in range(int(LONGEST / STEP)):
        true.step(current**2, 0.0, STEP)
        limit.add(current, STEP)
        limit.update(true.resistance)
        if step % 10 == 0:
            limit.forecast()
        limit.carries(load)
        holds = (
            bool(limit.warning()),
            limit.is_reduced,
            limit.is_sinking,
            bool(limit.stop()),
            true.copper > CRITICAL,
        )
        for name, event in zip(EVENTS, holds, strict=True):
            if event:
                found[name] = min(found[name], STEP * step)
        if found['stop'] == inf:
            error = max(error, abs(true.copper - limit.motor.winding))
        if found['board error'] < inf:
            break
    return found, error


def main() -> None:
    """Print the tables of load times and of braking."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    config, robot = load_arm_config(), load_robot()
    loads = JointLoads(config, robot)
    print('joint   load  copper   ' + ''.join(f'{name:>16}' for name in EVENTS) + '    error')
    print('        [Nm]  [W] cold ' + f'{"[s]":>16}' * len(EVENTS) + '      [K]')
    for joint, load in zip(config.joints, loads.load_max.tolist(), strict=True):
        rows = [times(joint, load, seed) for seed in SEEDS]
        cells = []
        for name in EVENTS:
            seen = [row[0][name] for row in rows]
            low, high = min(seen), max(seen)
            cells.append('never' if low == inf else f'{low:.0f} to {high:.0f}')
        loss = 1.5 * joint.motor.resistance * (load / joint.torque_per_ampere) ** 2
        error = max(row[1] for row in rows)
        columns = ''.join(f'{cell:>16}' for cell in cells)
        print(f'{joint.name}  {load:5.2f}  {loss:5.1f}    {columns}  {error:7.1f}')
    print()
    print('joint   inertia  energy   ' + '  '.join(f'{1e3 * c:g} mF' for c in CAPACITANCES))
    for joint, inertia in zip(config.joints, loads.inertia_max.tolist(), strict=True):
        joules = 0.5 * inertia * joint.velocity_max**2
        volts = [sqrt(VOLTAGE**2 + 2.0 * joules / c) for c in CAPACITANCES]
        rises = '  '.join(f'{value:4.0f} V' for value in volts)
        print(f'{joint.name}  {inertia:7.4f} {joules:5.2f} J   {rises}')


if __name__ == '__main__':
    main()
