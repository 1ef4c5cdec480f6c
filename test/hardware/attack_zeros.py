"""Attacks on arms that were just switched on, and on bridges that are restarted."""

from dataclasses import dataclass
from functools import partial

import numpy as np
from attack_rig import AttackRig
from attacks import ATTACKS

from aerarm_ros.description.arm_config import load_arm_config
from aerarm_ros.description.robot import load_robot
from aerarm_ros.hardware.boards.kept_zeros import HostClock, KeptZeros, arm_identity
from aerarm_ros.hardware.bridge_cycle import BridgeCycle
from aerarm_ros.hardware.frames.board_messages import TIMESTAMP_PERIOD

WRONG_MAX = 0.005  # [rad] largest error of an angle with a known zero
_HOST = HostClock('the same', 0.0)
_ASK = 50  # cycles between two requests of an attacker


@dataclass(frozen=True)
class ZeroOutcome:
    """Result of an attack.

    Attributes
    ----------
    driven
        Number of frames that let a board drive while a zero was unknown.
    accepted
        Number of accepted commands and requests, other than `home`, meanwhile.
    wrong
        Largest error [rad] of an angle whose zero counted as known.
    cycled
        Number of boards that were switched off and on while the bridge was stopped.
    unknown
        Number of joints with an unknown zero after the restart.
    beyond, speed
        As for the other attacks, once the arm was driven again.
    """

    attack: str
    number: int
    driven: int = 0
    accepted: int = 0
    wrong: float = 0.0
    cycled: int = 0
    unknown: int = 4
    beyond: float = -np.inf
    speed: float = 0.0

    @property
    def is_clean(self) -> bool:
        """Return whether no wrong angle counted as known, and no arm drove with an unknown zero."""
        quiet = self.driven == 0 and self.accepted == 0 and self.wrong <= WRONG_MAX
        found = self.unknown == 0 if self.cycled == 0 else self.unknown >= 2 * self.cycled
        return quiet and found


def _posture(config, random):
    low, high = config.column('position_min'), config.column('position_max')
    return random.uniform(low + 0.02, high - 0.02)


def _asked(rig: AttackRig, seconds: float, source) -> tuple[int, int]:
    """Attack an arm with unknown zeros; return the numbers of driving frames and acceptances."""
    before, accepted = rig.log.accepted, 0
    seen = len(rig.frames.commands(0)['enable_system']) if rig.cycles else 0
    for cycle in range(round(seconds / 1e-3)):
        rig.cycle(source)
        if cycle % _ASK == 0:
            bridge = rig.bridge
            accepted += sum(ask().accepted for ask in (bridge.enable, bridge.hold))
    frames = [rig.frames.commands(board)['enable_system'][seen:] for board in (0, 1)]
    return int(sum(np.sum(enabled) for enabled in frames)), accepted + rig.log.accepted - before


def attack_unknown(attack: str, number: int) -> ZeroOutcome:
    """Attack an arm that was switched on in any posture, and never homed."""
    config, robot = load_arm_config(), load_robot()
    random = np.random.default_rng([number, *attack.encode()])
    rig = AttackRig(config, robot, posture=_posture(config, random), homed=False)
    driven, accepted = _asked(rig, 0.4, ATTACKS[attack](random))
    return ZeroOutcome(attack, number, driven, accepted, cycled=2)


def attack_restart(attack: str, number: int) -> ZeroOutcome:
    """Restart the bridge during an attack, with boards that stayed on or were restarted."""
    config, robot = load_arm_config(), load_robot()
    random = np.random.default_rng([number, *attack.encode()])
    rig = AttackRig(config, robot, posture=_posture(config, random))
    for board in rig.boards.boards:
        board._clock = random.choice([0.0, random.uniform(0.0, 65.0), TIMESTAMP_PERIOD - 0.3])
        for motor in board.motors:
            motor.encoder.index_detected = True  # homing has detected the index
    rig.bridge = BridgeCycle(config, rig.world, robot=robot)
    rig.bridge.zeros.found()
    rig.bring_up()
    make = partial(ATTACKS[attack], np.random.default_rng(number))
    rig.run(random.uniform(0.1, 0.5), make())
    arm = arm_identity(config)
    kept = KeptZeros.parse(rig.bridge.recall.keep(arm, _HOST).text())
    # After a normal end of the bridge the file is up to a second old; a person holds the arm.
    rig.run(random.uniform(0.0, 0.2), make())
    rig.bridge.shutdown()
    rig.boards.carry()
    cycled = [board for board in (0, 1) if random.random() < 0.4]
    rig.world.pass_time(rig.now + random.uniform(0.2, 2.0))
    for board in cycled:
        rig.inject('power_cycle', board)
    rig.world.pass_time(rig.now + random.uniform(0.1, 1.0))
    rig.bridge = BridgeCycle(config, rig.world, robot=robot, kept=kept.check(arm, _HOST, rig.now))
    rig.run(0.02)
    known = np.array(rig.bridge.zeros.known)
    wrong = float(np.abs(rig.bridge.q - rig.plant.position)[known].max(initial=0.0))
    unknown = int((~known).sum())
    outcome = partial(ZeroOutcome, attack, number, wrong=wrong, cycled=len(cycled), unknown=unknown)
    if unknown:
        driven, accepted = _asked(rig, 0.3, make())
        return outcome(driven=driven, accepted=accepted)
    if not rig.bridge.gate.is_inside(rig.bridge.q):
        return outcome()
    log = rig.bring_up().run(0.5, make())
    return outcome(
        beyond=float(log.beyond(config).max()), speed=float(log.speed_ratio(config).max())
    )
