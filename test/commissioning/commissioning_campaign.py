"""Commission emulated arms, healthy ones and ones with assembly errors, in virtual time.

Usage: make commissioning, or python test/commissioning/commissioning_campaign.py --seeds 10

`Commissioning` runs the whole procedure for each arm on `BridgeCycle`; an emulated hand performs
the user's actions. The program prints the findings of each arm. It returns 1 if a healthy arm has
a finding or an error has none.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import UTC, datetime

from aerarm_ros.commissioning.commissioning import Commissioning
from aerarm_ros.commissioning.commissioning_record import CommissioningRecord
from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.boards.commissioning_probe import ProbeReport, ProbeRequest
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.emulation.emulation import make_emulated_transport
from aerarm_ros.hardware.emulation.fault_injection import FaultRequest
from aerarm_ros.parallel import run_in_order

_ASK_EVERY = 100  # cycles between two requests of the client
_LONGEST = 200.0  # [s] of virtual time
# Assembly errors, and the required text of their findings.
ERRORS = {
    'swapped_channels:0': 'encoder of joint',
    'swapped_channels:1': 'encoder of joint',
    'wrong_sign:0:0': 'counts in the opposite direction',
    'wrong_sign:0:1': 'counts in the opposite direction',
    'wrong_sign:1:1': 'counts in the opposite direction',
    'wrong_ratio:0:0:27': 'motor makes 2',
    'wrong_ratio:0:1:31': 'motor makes 3',
    'wrong_ratio:1:0:28': 'motor makes 2',
    'weak_driver:0:0:0.5': 'delivers 5',
    'weak_driver:0:1:0.5': 'delivers 5',
    'weak_driver:1:0:0.5': 'delivers 5',
    'weak_driver:1:1:0.5': 'delivers 5',
    'high_friction:0:0:4': 'friction is',
    'high_friction:1:1:5': 'friction',
    'dead_board:1': 'does not answer',
    'stuck_encoder:0:1': 'no encoder counted',
}


class CommissionedArm:
    """An emulated arm, its bridge, and its user, in virtual time.

    Parameters
    ----------
    seed
        Seed of the arm's deviations from its nominal parameters; None for an arm as drawn.
    fault
        Fault in the form of `arm fault`; '' for none.
    """

    def __init__(self, seed: int | None, fault: str = '') -> None:
        self.config, self.robot = load_arm_config(), load_robot()
        self.boards = make_emulated_transport(self.config, self.robot, seed)
        self.bridge = BridgeCycle(self.config, self.boards, robot=self.robot)
        self.now = 0.0
        self.prompts: list[str] = []
        self.pass_time(0.05)
        if fault:
            self.inject(fault)
            self.pass_time(0.05)

    def inject(self, fault: str) -> None:
        """Inject a fault."""
        FaultRequest.parse(fault, len(self.boards.boards)).apply(self.boards)

    def ask(self, request: ProbeRequest) -> ProbeReport:
        """Return the bridge's answer to a request."""
        return self.bridge.probe.ask(request, self.bridge.mode)

    def pass_time(self, duration: float, guided: Commissioning | None = None) -> None:
        """Run the bridge for a time [s], with ten requests of the procedure per second."""
        for cycle in range(round(1e3 * duration)):
            self.now += 1e-3
            self.bridge.update(self.now)
            if guided is not None and cycle % _ASK_EVERY == 0:
                guided.update(datetime.now(UTC), self.ask(guided.request))

    def commission(self, joints: Sequence[int] | None = None) -> CommissioningRecord:
        """Run the procedure for some joints, by default all; return the record."""
        config = self.config
        record = CommissioningRecord(config.name, emulated=True)
        chosen = range(config.n) if joints is None else joints
        guided = Commissioning(config, self.robot, record, chosen, 'bench')
        while not guided.is_done and self.now < _LONGEST:
            self.pass_time(0.1, guided)
            prompt = guided.prompt
            if prompt is None:
                continue
            self.prompts.append(prompt.text)
            if prompt.hand is not None:
                name, angle = prompt.hand
                duration = self.boards.turn(config.joint_names.index(name), angle)
                self.pass_time(duration, guided)
            guided.answer(True)
        return guided.record


def _run(seed: int, fault: str) -> tuple[int, str, list[str]]:
    joints = None
    if fault:  # the joints of the fault's board, or the joint of its channel
        places = [int(place) for place in fault.split(':')[1:3]]
        joints = [2 * places[0] + places[1]] if len(places) > 1 else [2 * places[0]]
    record = CommissionedArm(seed, fault).commission(joints)
    return seed, fault, [text for joint in record.joints.values() for text in joint.findings]


def main() -> int:
    """Run all cases."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--seeds', type=int, default=10, help='healthy arms (default: 10)')
    parser.add_argument('--processes', type=int, default=2, help='at a time (default: 2)')
    options = parser.parse_args()
    cases = [(seed, '') for seed in range(options.seeds)]
    cases += [(seed % 10, fault) for seed, fault in enumerate(ERRORS)]
    wrong = 0
    for seed, fault, findings in run_in_order(_run, cases, options.processes):
        said = '; '.join(findings)
        good = ERRORS[fault] in said if fault else not findings
        wrong += not good
        print(f'{"ok " if good else "BAD"} seed {seed} {fault or "healthy"}: {said}', flush=True)
    print(f'{len(cases)} arms, {wrong} misjudged')
    return 1 if wrong else 0


if __name__ == '__main__':
    sys.exit(main())
