"""Attack the bridge at random, and print the result of each kind of attack: `make attacks`.

The table has one row per attack with the number of runs. It shows the largest distance of the true
arm beyond a position limit, and the highest true speed as a fraction of its limit. The arm of the
worst run is listed for a repetition. Then the attacks are repeated on arms that were just switched
on, with unknown zeros, and on bridges that are restarted (`attack_zeros`). The exit status is 1 if
a promise was broken.

With `--lost-commands RATE ...` the boards lose that fraction of the commands from a random moment
on, while their answers arrive. The lost signal is MOSI of the first board, of the second, or of
both. The table then shows, and limits, the speed while the boards drive. A board that receives no
commands switches its motors off after `board_timeout`, and the arm falls.
"""

import argparse
import sys
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from attack_rig import AttackRig
from attack_zeros import ZeroOutcome, attack_restart, attack_unknown
from attacks import ATTACKS, WITHOUT_EFFORT

from aerarm_ros.description.arm_config import DriveTrain, load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.joint_barrier import JointLoads
from aerarm_ros.parallel import run_in_order

BEYOND_MAX = 0.02  # [rad]
SPEED_MAX = 1.15
_SECONDS = 1.5
_LOSING_SECONDS = 0.8  # after the connection begins to lose commands
_LOSING_BOARDS = ((0,), (1,), (0, 1))


@dataclass(frozen=True)
class Outcome:
    """Result and identification of a run."""

    attack: str
    number: int
    beyond: float
    joint_beyond: int
    speed: float
    joint_speed: int
    arm: str
    faults: tuple[str, ...]

    @property
    def names_the_wire(self) -> bool:
        """Return whether the reason of a stop, if any, does not name a working part."""
        return not any('check the controller and the encoder' in fault for fault in self.faults)

    @property
    def is_doubted(self) -> bool:
        """Return whether the bridge reported a wrong angle of a sound encoder."""
        return any('must have turned it' in fault for fault in self.faults)


def run(
    attack: str,
    number: int,
    seconds: float = _SECONDS,
    settings: BridgeSettings | None = None,
    lost_commands: float = 0.0,
) -> Outcome:
    """Run an attack on the arm of a number, with a fraction of the commands lost."""
    config, robot = load_arm_config(), load_robot()
    random = np.random.default_rng([number, *attack.encode()])
    low, high = config.column('position_min'), config.column('position_max')
    posture = random.uniform(low + 0.02, high - 0.02)
    payload = float(random.choice([0.0, 0.5, 1.0])) * config.rated_payload[0]
    seed = None if number % 3 == 0 else int(random.integers(1, 1000))
    gains: tuple[np.ndarray, ...] | None = None
    if number % 4 == 1:
        least = DriveTrain(config).joint_to_motor_gain(JointLoads(config, robot).damping_min)
        kd = np.exp(random.uniform(np.log(least + 1e-3), np.log(0.61)))
        gains = (random.uniform(0.0, 5.09, 4), kd)
    gravity = None
    if number % 5 == 4:
        down = random.standard_normal(3)
        gravity = 9.81 * down / np.linalg.norm(down)
    if number % 8 == 7 and attack in WITHOUT_EFFORT:
        # Boards with an integral, in frames without a feedforward current.
        config = replace(config, profile='laas_power')
        kp, kd = config.column('board_kp'), config.column('board_kd')
        gains = (kp, kd, random.uniform(1.0, 5.09, 4))
    made = {'posture': posture, 'payload': payload, 'seed': seed, 'gravity': gravity}
    rig = AttackRig(config, robot, settings=settings, gains=gains, **made).bring_up()
    source = ATTACKS[attack](random)
    if lost_commands:
        rig.run(random.uniform(0.05, 0.6), source)
        for board in _LOSING_BOARDS[number % 3]:
            rig.inject('lost_commands', board, 0, lost_commands)
    log = rig.run(seconds, source).driven()
    beyond, speed = log.beyond(config), log.speed_ratio(config)
    arm = f'q {posture.round(2)} m {payload:.1f} seed {seed}'
    if gains is not None:
        named = zip(('kp', 'kd', 'ki'), gains, strict=False)
        arm += ''.join(f' {name} {gain.round(2)}' for name, gain in named)
    if gravity is not None:
        arm += f' gravity {gravity.round(1)}'
    far, fast = (int(values.argmax()) for values in (beyond, speed))
    worst = (float(beyond[far]), far + 1, float(speed[fast]), fast + 1)
    return Outcome(attack, number, *worst, arm, tuple(log.faults))


def _row(outcomes: list[Outcome]) -> str:
    far = max(outcomes, key=lambda o: o.beyond)
    fast = max(outcomes, key=lambda o: o.speed)
    stopped = sum(bool(outcome.faults) for outcome in outcomes)
    return (
        f'{far.attack:25}{len(outcomes):5}{far.beyond:9.4f} (joint {far.joint_beyond}, '
        f'#{far.number}){fast.speed:8.3f} (joint {fast.joint_speed}, #{fast.number})'
        f'{stopped:5} stopped'
    )


def _report(outcomes: list[Outcome], losing: bool, verbose: bool) -> int:
    """Print the runs that broke a promise, or all; return the number of the former."""
    broken = 0
    for outcome in outcomes:
        is_bad = outcome.speed > SPEED_MAX or outcome.is_doubted
        is_bad |= not outcome.names_the_wire if losing else outcome.beyond > BEYOND_MAX
        broken += is_bad
        if is_bad or verbose:
            print(f'  #{outcome.number}: {outcome}', flush=True)
    return broken


def _zero_row(name: str, outcomes: list[ZeroOutcome]) -> str:
    restarted = [outcome for outcome in outcomes if np.isfinite(outcome.beyond)]
    return (
        f'{name:25}{len(outcomes):5} driven {sum(o.driven for o in outcomes)}, accepted '
        f'{sum(o.accepted for o in outcomes)}, known angles wrong by '
        f'{max(o.wrong for o in outcomes):.4f} rad; boards cycled in '
        f'{sum(o.cycled > 0 for o in outcomes)}; {len(restarted)} driven again: beyond '
        f'{max((o.beyond for o in restarted), default=-np.inf):.4f}, speed '
        f'{max((o.speed for o in restarted), default=0.0):.3f}'
    )


def _attack_zeros(names: list[str], numbers: range, processes: int) -> int:
    """Print rows for unknown zeros and for restarts; return the number of broken promises."""
    broken = 0
    for name, attack in (('unknown zeros', attack_unknown), ('restarts', attack_restart)):
        runs = [(one, number) for one in names for number in numbers]
        outcomes = list(run_in_order(attack, runs, processes))
        print(_zero_row(name, outcomes), flush=True)
        for outcome in outcomes:
            if not outcome.is_clean or outcome.beyond > BEYOND_MAX or outcome.speed > SPEED_MAX:
                broken += 1
                print(f'  {outcome}', flush=True)
    return broken


def main() -> int:
    """Run the campaign."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--runs', type=int, default=20, help='of each attack')
    parser.add_argument('--first', type=int, default=0, help='number of the first')
    parser.add_argument('--only', nargs='*', default=list(ATTACKS))
    parser.add_argument('--zeros-only', action='store_true', help='unknown zeros and restarts')
    parser.add_argument('--processes', type=int, default=0)
    parser.add_argument('--verbose', action='store_true')
    parser.add_argument('--period', type=float, default=BridgeSettings().period, help="the host's")
    parser.add_argument('--lost-commands', type=float, nargs='*', default=[], metavar='RATE')
    options = parser.parse_args()
    settings, processes = BridgeSettings(period=options.period), options.processes
    numbers, broken = range(options.first, options.first + options.runs), 0
    for rate in options.lost_commands:
        given = (_LOSING_SECONDS, settings, rate)
        runs = [(name, number, *given) for name in options.only for number in numbers]
        outcomes = list(run_in_order(run, runs, processes))
        print(f'{100 * rate:4.0f} % lost  {_row(outcomes)[25:]}', flush=True)
        broken += _report(outcomes, True, options.verbose)
    if not options.lost_commands:
        names = [] if options.zeros_only else options.only
        runs = [(name, number, _SECONDS, settings) for name in names for number in numbers]
        results = run_in_order(run, runs, processes)
        for _ in names:
            outcomes = list(islice(results, len(numbers)))
            print(_row(outcomes), flush=True)
            broken += _report(outcomes, False, options.verbose)
        broken += _attack_zeros(options.only, numbers, processes)
    print(f'{broken} runs broke a promise')
    return 1 if broken else 0


if __name__ == '__main__':
    sys.exit(main())
