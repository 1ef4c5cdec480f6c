"""Share of FollowJointTrajectory goals that controllers reach, by method against steady errors.

The benchmark runs in virtual time on emulated boards, with arms that deviate from their model
(`seed` of `fake_hardware`). Each arm receives five rest-to-rest motions of 0.1 to 2 rad, then
rests. A goal succeeds by the default tolerances (0.01 rad within 1 s). The arm has settled when
every true joint stays within 0.005 rad and below 0.01 rad/s. A joint in a limit cycle reverses
repeatedly at rest; reversals of more than 0.2 mrad, about four encoder counts, are counted.
"""

import argparse
import sys
import tempfile
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from goal_runs.goal_bench import CONTROLLERS, GoalBench, ReachedGoal, Rest, arm_truth
from goal_runs.identified_files import identified_urdf_file

DISTANCES = (0.1, 0.3, 0.7, 1.3, 2.0)  # [rad]
SETTLING = 0.5  # [s]
# Methods to compare, as parameters that replace the defaults.
WAYS: Mapping[str, Mapping[str, Any]] = {
    'shipped': {},
    'nothing': {'compensation': 0.0},
    'ki 1000': {'compensation': 0.0, 'ki': 1000.0},
    'ki 4000': {'compensation': 0.0, 'ki': 4000.0},
    'friction 0': {'friction_fraction': 0.0},
    'friction 0.7': {'friction_fraction': 0.7},
    'friction 0.7 alone': {'friction_fraction': 0.7, 'compensation': 0.0},
    'observer 0.1': {'compensation': 0.1},
    'observer 0.3': {'compensation': 0.3},
}
# Conditions of the emulated arm and its host, as arguments of the bench.
CONDITIONS: Mapping[str, Mapping[str, Any]] = {
    'plain': {},
    'payload': {'payload': 0.2},
    'backlash': {'backlash': 2e-3},
    'stiction': {'stiction': 0.5},
    'late': {'delay': 3},
}
HEADINGS = (
    *('controller', 'way', 'model', 'condition', 'goals', 'settled', 'latest [s]'),
    *('RMS [mrad]', 'peak', 'at rest', 'turns', 'travel', 'ripple [Nm]'),
)
LINE = '{:24} {:20} {:10} {:9} {:>8} {:>8} {:>10} {:>10} {:>6} {:>7} {:>5} {:>6} {:>11}'


def run(
    controller: str, way: str, model: str, condition: str, seeds: range, rest: float
) -> tuple[list[ReachedGoal], list[Rest]]:
    """Send every goal to the arm of every seed."""
    goals, rests = [], []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as folder:
            known = {}
            if model == 'identified':
                known['urdf'] = str(
                    identified_urdf_file(arm_truth(seed), seed, Path(folder) / 'arm')
                )
            bench = GoalBench(controller, seed, **CONDITIONS[condition], **WAYS[way], **known)
        goals += [bench.go(bench.draw_goal(distance)) for distance in DISTANCES]
        rests.append(bench.rest(rest))
    return goals, rests


def line(names: tuple[str, ...], goals: list[ReachedGoal], rests: list[Rest]) -> str:
    """Return the results of one run as a line of the table."""
    reached = sum(g.result.state == 'succeeded' for g in goals)
    settled = sum(g.settling <= SETTLING for g in goals)
    rms = 1e3 * float(np.mean([g.tracking for g in goals]))
    return LINE.format(
        *names,
        f'{reached}/{len(goals)}',
        f'{settled}/{len(goals)}',
        f'{max(g.settling for g in goals):.2f}',
        f'{rms:.2f}',
        f'{1e3 * max(g.peak for g in goals):.1f}',
        f'{1e3 * max(r.error for r in rests):.2f}',
        max(r.reversals for r in rests),
        f'{1e3 * max(r.travel for r in rests):.2f}',
        f'{max(r.ripple for r in rests):.3f}',
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--controllers', nargs='*', default=list(CONTROLLERS), choices=CONTROLLERS)
    parser.add_argument('--ways', nargs='*', default=['shipped', 'nothing'], choices=WAYS)
    parser.add_argument('--models', nargs='*', default=['drawn'], choices=('drawn', 'identified'))
    parser.add_argument('--conditions', nargs='*', default=['plain'], choices=CONDITIONS)
    parser.add_argument('--seeds', type=int, default=20, help='number of emulated arms')
    parser.add_argument('--first', type=int, default=0, help='seed of the first arm')
    parser.add_argument('--rest', type=float, default=3.0, help='time at rest after the goals [s]')
    options = parser.parse_args()
    seeds = range(options.first, options.first + options.seeds)
    print(LINE.format(*HEADINGS), flush=True)
    failed = False
    for names in product(options.controllers, options.ways, options.models, options.conditions):
        controller, way, *_ = names
        if 'ki' in WAYS[way] and controller == 'gravity_compensation':
            continue
        goals, rests = run(*names, seeds, options.rest)
        print(line(names, goals, rests), flush=True)
        failed |= way == 'shipped' and any(
            g.result.state != 'succeeded' or g.settling > SETTLING for g in goals
        )
    return int(failed)


if __name__ == '__main__':
    sys.exit(main())
