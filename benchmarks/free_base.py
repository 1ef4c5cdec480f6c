"""Joint error of an arm under a drone of similar mass, compared with an arm on a fixed base.

`fake_hardware`, `computed_torque` and `flight_control` run as processes in lockstep, so the figures
do not depend on the host. Drones of other masses are scaled versions of the packaged ones. The arm
hangs down; "slow" swings its joints by 0.4 to 0.5 rad at 0.2 to 0.35 Hz, "fast" by 0.5 to 0.8 rad
at 0.5 to 0.9 Hz. Errors are computed from joint_states, relative to the reference at each state's
stamp. The arm equals the controller's model. In the last cases the arm deviates from its model, and
the controller uses parameters that `identifier` estimates from a recorded excitation.
"""

import argparse
import tempfile
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from control import FREE_GOAL, free_over_fixed
from flying.arm_model import ArmModel
from flying.arm_swing import MOTIONS, RAMP, ArmSwing
from flying.flight_bench import FlightBench
from flying.flight_case import FlightCase
from flying.node_bench import FAILURES, reason, ros_node
from rclpy.node import Node

MASSES = (1.3, 2.0, 3.0, 5.0, 10.0)
WHAT = [case.wrong for case in FlightCase(1.0, 'free').variants()]
BASES = ('none', 'attitude', 'full', 'free')
LINE = '{:>7} {:9} {:23} {:10} {:5} {:>10} {:>6} {:>6} {:>6}'
HEADINGS = ('drone', 'uses', 'model error', 'arm', '', 'RMS [mrad]', 'max', 'growth', 'mm off')
GOALS = {'true': 1.3, 'identified': 2.0}
SHORTEST = 3.0 * RAMP  # [s]
LOST = 1.0  # [m] error above which the drone is lost, and joint errors are meaningless


def growth(times: np.ndarray, errors: np.ndarray) -> float:
    """Return the ratio of the RMS in the last third to the RMS in the first third."""
    first, last = np.quantile(times, [1 / 3, 2 / 3])
    parts = errors[times < first], errors[times > last]
    return float(np.sqrt((parts[1] ** 2).mean() / (parts[0] ** 2).mean()))


@dataclass
class Campaign:
    """Sequence of cases, each printed when finished.

    Attributes
    ----------
    lengths : dict
        Durations of the motions [s].
    results : dict
        RMS error [mrad] and growth by arm, case and motion; infinite after a failure.
    """

    node: Node
    lengths: dict[str, float]
    results: dict[tuple[str, FlightCase, str], tuple[float, float]] = field(default_factory=dict)

    def run(self, case: FlightCase, arm: ArmModel) -> None:
        """Fly a case and print its lines."""
        drone = f'{case.mass:g} kg' if case.mass else 'fixed'
        heading = (drone, case.base, case.wrong, arm.name)
        self.results.update({(arm.name, case, name): (np.inf, np.inf) for name in self.lengths})
        try:
            with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
                bench = FlightBench(stack, self.node, Path(folder), case, arm)
                for name, seconds in self.lengths.items():
                    times, errors = bench.move(ArmSwing(name, seconds))
                    rms, grown = float(np.sqrt((errors**2).mean())), growth(times, errors)
                    away = bench.listener.farthest
                    if away > LOST:
                        raise ValueError(f'the drone drifted {away:.1f} m away in {name} motion')
                    self.results[arm.name, case, name] = rms, grown
                    off = f'{1e3 * away:.0f}' if case.mass else ''
                    figures = f'{rms:.2f}', f'{np.abs(errors).max():.1f}', f'{grown:.2f}', off
                    print(LINE.format(*heading, name, *figures), flush=True)
        except FAILURES as error:
            print(LINE.format(*heading, '', *'----'), reason(error), flush=True)

    def summary(self) -> None:
        """Print the results and their goals."""
        over: dict[str, float] = {}
        worse, grown = 0.0, 0.0
        for (arm, case, motion), (rms, growth_of_it) in self.results.items():
            if case.base != 'free':
                continue
            grown = max(grown, growth_of_it)
            fixed = self.results.get((arm, FlightCase(0.0, 'none'), motion))
            ignored = self.results.get((arm, FlightCase(case.mass, 'none'), motion))
            if case.wrong == FlightCase.wrong and fixed:
                over[arm] = max(over.get(arm, 0.0), rms / fixed[0])
            if ignored:
                worse = max(worse, rms / ignored[0])
        for arm, ratio in over.items():
            print(
                f'Error with a free base relative to a fixed base, {arm} arm: {ratio:.2f} '
                f'(goal: {GOALS[arm]:g})'
            )
        print(
            'Error with a free base relative to an ignored base, largest over all model '
            f'errors: {worse:.2f} (goal: 1)'
        )
        print(f'Error in the last third of a motion relative to the first, free base: {grown:.2f}')


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        '--masses', type=float, nargs='*', default=MASSES, help='masses of the drones [kg]'
    )
    parser.add_argument(
        '--bases', nargs='*', default=BASES, help='values of the parameter base_motion'
    )
    parser.add_argument('--wrong', type=float, nargs='*', default=[1.3, 3.0],
                        help='masses of drones for runs with model errors [kg]')  # fmt: skip
    parser.add_argument(
        '--wrong-bases', nargs='*', default=['free'],
                        help='values of base_motion for runs with model errors')  # fmt: skip
    parser.add_argument(
        '--what', nargs='*', default=WHAT, choices=WHAT, help='model errors to simulate'
    )
    parser.add_argument('--identified', type=float, nargs='*', default=MASSES,
                        help='masses of drones with an identified arm [kg]')  # fmt: skip
    parser.add_argument('--arm-seed', type=int, default=7, help='seed of the identified arm')
    parser.add_argument('--seconds', type=float, nargs=2, default=(14.0, 14.0),
                        help='durations of the slow and of the fast motion [s]')  # fmt: skip
    options = parser.parse_args()
    if min(options.seconds) < SHORTEST:
        parser.error(
            f'argument --seconds must be at least {SHORTEST:g} s, because start and end take '
            'most of a shorter motion'
        )
    with ros_node() as node:
        campaign = Campaign(node, dict(zip(MOTIONS, options.seconds, strict=True)))
        fly(campaign, options)
        campaign.summary()
    law, cycle = free_over_fixed()
    print(f'Computing time with a free base relative to a fixed base: law {law:.2f} (goal: '
          f'{FREE_GOAL:g}), whole cycle {cycle:.2f}')  # fmt: skip


def fly(campaign: Campaign, options: argparse.Namespace) -> None:
    """Run all cases that the options choose."""
    print(LINE.format(*HEADINGS))
    arm = ArmModel.true()
    campaign.run(FlightCase(0.0, 'none'), arm)
    for mass in options.masses:
        for base in options.bases:
            campaign.run(FlightCase(mass, base), arm)
    for mass in options.wrong:
        for base in options.wrong_bases:
            for case in FlightCase(mass, base).variants():
                if case.wrong in options.what:
                    campaign.run(case, arm)
    if options.identified:
        with tempfile.TemporaryDirectory() as folder:
            arm = ArmModel.identified(campaign.node, Path(folder), options.arm_seed)
            campaign.run(FlightCase(0.0, 'none'), arm)
            for mass in options.identified:
                campaign.run(FlightCase(mass, 'free'), arm)


if __name__ == '__main__':
    main()
