"""Energy of least-energy motions, compared with quintics and trapezoids of equal duration.

`fake_hardware`, `computed_torque`, `motion_planner` and `recorder` run as processes in lockstep, so
the figures do not depend on the host. Moves are drawn uniformly over the joints' ranges, and each
is played back and forth in three shapes. The energy is that drawn from the supply for the motors
until 0.2 s after the motion, computed from joint_states (see `BalanceMeter`); braking energy is
lost. The arm deviates from its model. Planner and controller use the parameters that `identifier`
estimates from a recorded excitation (with `--model true` the arm equals its model). `make energy`
plays 100 moves and writes a page.
"""

import argparse
import json
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from itertools import islice
from pathlib import Path

import numpy as np
from energy_moves.energy_bench import SHAPES, EnergyBench, Move, Taken, draw_moves
from energy_moves.energy_figures import energy_page, figures
from flying.arm_model import ArmModel
from flying.node_bench import ros_node
from flying.pages import write_page

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.energy.energy_model import EnergyModel
from aerarm_ros.excitation.excitation_setup import ExcitationSetup
from aerarm_ros.excitation.settings import load_excitation_config
from aerarm_ros.planner.motion_plan import PlanError
from aerarm_ros.planner.motion_planner import MotionPlanner

BATCH = 10  # pairs of moves per bag
PACK = 100.0  # [Wh] energy of the battery


def known(arm: ArmModel) -> tuple[EnergyModel, MotionPlanner]:
    """Return the model of the nodes, and a planner with the same settings."""
    config = load_arm_config()
    robot = load_robot(arm.law.get('urdf'), joint_names=config.joint_names)
    model = EnergyModel(config, robot, arm.law.get('rotor_inertia'), arm.law['load_friction'])
    setup = ExcitationSetup.of_arm(robot, config, load_excitation_config())
    return model, MotionPlanner(model, setup)


def play(bench: EnergyBench, planner: MotionPlanner, pairs: list[tuple[int, Move]]) -> None:
    """Play moves back and forth in every shape."""
    here = np.array(load_arm_config().rest_position)
    for number, move in pairs:
        try:
            bench.go(planner.with_settings(objective='quintic').plan(here, move.start).path)
        except PlanError:
            bench.go(planner.with_settings(duration=2.0).plan(here, move.start).path)
        for shape in SHAPES:
            bench.play(2 * number, shape, move)
            bench.play(2 * number + 1, shape, move.back)
        here = move.start
        print(f'moves {2 * number} and {2 * number + 1} of {move.duration:.2f} s', flush=True)


def measure(folder: Path, options: argparse.Namespace) -> Iterator[tuple[list[Taken], list[str]]]:
    """Yield results of the moves so far, and rejected moves."""
    arm = ArmModel.chosen(options, folder)
    model, planner = known(arm)
    drawn = draw_moves(planner, options.seed, options.durations)
    pairs = list(enumerate(islice(drawn, (options.moves + 1) // 2)))[options.first // 2 :]
    for first in range(0, len(pairs), BATCH):
        part = folder / f'part_{first // BATCH}'
        part.mkdir()
        with ros_node() as node, ExitStack() as stack:
            bench = EnergyBench(stack, node, part, arm, model)
            play(bench, planner, pairs[first : first + BATCH])
            yield bench.results(), bench.refused
        shutil.rmtree(part / 'bag')


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--moves', type=int, default=4, help='number of random moves, even')
    parser.add_argument('--first', type=int, default=0, help='number of moves to omit at the start')
    parser.add_argument('--seed', type=int, default=1, help='seed of the random moves')
    parser.add_argument('--durations', type=float, nargs=2, default=[2.0, 4.0],
                        help='shortest and longest duration of a move [s]')  # fmt: skip
    ArmModel.add_options(parser)
    parser.add_argument('--out', type=Path, help='folder for the page and the results')
    options = parser.parse_args()
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
    results: list[Taken] = []
    refused: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        for part, reasons in measure(Path(folder), options):
            results += part
            refused += reasons
            if options.out:  # also keep the results after an error
                rows = {'moves': [asdict(one) for one in results], 'refused': refused}
                (options.out / 'energy.json').write_text(json.dumps(rows))
    found = figures(results)
    standby = load_arm_config().power_stage.standby
    note = (
        f'{len(found.by_shape["planned"])} random moves of {options.durations[0]:g} to '
        f'{options.durations[1]:g} s with the arm {options.model}; battery capacity {PACK:g} Wh.'
    )
    print(f'{note}\n{found.text(standby, PACK)}')
    for reason in refused:
        print(f'refused: {reason}')
    if options.out:
        body = energy_page(found, standby, PACK, note, refused)
        write_page(options.out / 'energy.html', 'Energy of motions', body)
    return 0


if __name__ == '__main__':
    sys.exit(main())
