"""The recovery hint of every fault leads to recovery, on emulated boards of both kinds."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest

from aerarm_ros.hardware.boards import homing
from aerarm_ros.hardware.bridge_modes import Answer
from aerarm_ros.hardware.emulation.emulated_board import BoardFaults

MOVING = [0.8, 0.0, 0.8, 0.8]
# What is found in motion, or where a current flows.
NOT_AT_REST = ('stuck_encoder', 'board_timeout')
KINDS = pytest.mark.parametrize('emulated', [True, False], ids=['emulated', 'real'])


def injected(fault: str, board: int = 0, motor: int = 0, value: float | None = None):
    def break_it(rig) -> None:
        moving = (lambda now: (None, MOVING, None)) if fault in NOT_AT_REST else None
        if moving:
            rig.run(0.2, moving)
        rig.inject(fault, board, motor, value)
        rig.run_until('fault', 0.3, moving)
        rig.run(0.02, moving)

    return break_it


def stopped_by_hand(rig) -> None:
    rig.bridge.e_stop('test')
    rig.run(0.02)


def stopped_and_sunk(rig) -> None:
    """The arm has sunk meanwhile, so it would stop again at once."""
    rig.bridge.e_stop('test')
    rig.run(0.02)
    beyond = rig.config.joints[1].position_max + 0.08
    start = rig.plant.position.copy()
    for share in np.linspace(0.0, 1.0, 300):
        rig.plant.reset([start[0], start[1] + share * (beyond - start[1]), *start[2:]])
        rig.cycle()


def asked_too_far(rig) -> None:
    rig.run(0.05, lambda now: (None, None, [1e3, 0.0, 0.0, 0.0]))


def power_cycled_while_driven(rig) -> None:
    rig.inject('power_cycle', 1)
    rig.run(0.05)


def lost_at_homing(rig) -> None:
    rig.bridge.gate.trip('no index pulse was met')
    rig.run(0.02)


def told_by_a_board(rig) -> None:
    """Faults that emulated boards do not have: frozen data, motors that never align."""
    rig.bridge.links[0].monitor.fail('its frames are correct but their data is frozen')
    rig.run(0.02)


FAULTS: dict[str, Callable] = {
    'e_stop': stopped_by_hand,
    'beyond a limit': stopped_and_sunk,
    'command far beyond a limit': asked_too_far,
    'homing': lost_at_homing,
    'frozen data': told_by_a_board,
    'restarted board': power_cycled_while_driven,
    'dead board 0': injected('dead_board', 0),
    'dead board 1': injected('dead_board', 1),
    'bit errors': injected('bit_errors', 1, 0, 1.0),
    'lost frames': injected('lost_frames', 0, 0, 1.0),
    'encoder jump': injected('encoder_jump', 0, 0, None),
    'small encoder jump': injected('encoder_jump', 1, 1, -2.0),
    'stuck encoder': injected('stuck_encoder', 1, 1),
    'over-temperature': injected('over_temperature', 0),
    'driver error': injected('driver_error', 1),
    'time-out of a board': injected('board_timeout', 1),
    'slow bus': injected('slow_bus', 0),
}


def command(rig, words: str, emulated: bool) -> Answer:
    """Do the bridge's action for `arm WORDS`."""
    bridge, boards = rig.bridge, rig.boards
    if words.startswith('fault power_cycle:'):
        assert emulated
        rig.inject('power_cycle', int(words.partition(':')[2]))
        return Answer(True, '')
    if words == 'enable' and bridge.mode == 'idle':
        if bridge.gate.is_inside(bridge.q):
            boards.carry()  # by the emulation, or by a person
        elif emulated:
            boards.put_back()
        bridge.update(rig.now)  # see where it is now, and that it rests
    if words == 'home' and emulated:
        put_near_rest(rig)
        bridge.update(rig.now)
    return getattr(bridge, words)()


def put_near_rest(rig) -> None:
    """Bring the arm to its home configuration by hand; index pulses are near."""
    rig.boards._put(np.array(rig.config.rest_position) - 0.02)


def by_hand(rig, step: str) -> None:
    """Follow a recovery hint by hand."""
    if step == 'support the arm':
        rig.boards.carry()
    elif step == 'repair the cause':
        for board in rig.boards.boards:
            dead = board.faults.dead
            board.faults = BoardFaults()
            if dead:
                board.power_cycle()
            for motor in board.motors:
                if motor.encoder.stuck:
                    motor.encoder.restart()  # what it turned meanwhile was not counted
    elif switched := re.fullmatch(r'switch the supply of board(\d) off and on', step):
        rig.inject('power_cycle', int(switched[1]))
    elif step == 'move the arm by hand to its home configuration':
        put_near_rest(rig)
    else:
        assert step == 'move the arm inside its limits by hand'
        rig.boards.put_back()


def follow(rig, steps: str, emulated: bool) -> None:
    for step in steps.split(', '):
        # What is left to do is named at each step.
        left = rig.bridge.recovery_hint(emulated)
        assert left.endswith("'arm home'") or not steps.endswith("'arm home'"), (step, left)
        quoted = re.match("'arm ([^']*)'", step)
        if quoted is None:
            assert not emulated
            by_hand(rig, step)
            rig.run(0.02)
            continue
        answer = command(rig, quoted[1], emulated)
        assert answer.accepted, (steps, step, answer.message)
        rig.run(0.02)
    rig.align()  # motors that were off
    rig.run_until('ready', 3.0)


@KINDS
@pytest.mark.parametrize('fault', FAULTS)
def test_the_stated_recovery_steps_clear_the_fault(
    make_rig, monkeypatch: pytest.MonkeyPatch, fault: str, emulated: bool
) -> None:
    for speed in ('_SPEED', '_RETURN_SPEED'):  # homing has tests of its own
        monkeypatch.setattr(homing, speed, 0.5)
    rig = make_rig(seed=3).bring_up()
    assert rig.bridge.recovery_hint(emulated) == ''
    FAULTS[fault](rig)
    assert rig.bridge.mode == 'fault', fault
    steps = rig.bridge.recovery_hint(emulated)
    follow(rig, steps, emulated)
    assert rig.bridge.mode == 'ready', (steps, rig.bridge.faults)
    assert rig.bridge.recovery_hint(emulated) == ''
    # Its angles are the true ones, and it can be commanded.
    assert rig.bridge.q == pytest.approx(rig.plant.position, abs=1e-3)
    rig.run(0.02, lambda now: (None, [0.2, 0.0, 0.0, 0.0], None))
    assert rig.bridge.mode == 'running', (steps, rig.bridge.faults)


def test_after_clear_fault_an_intact_arm_is_held_in_place(rig) -> None:
    stopped_by_hand(rig)
    assert rig.bridge.recovery_hint(False) == rig.bridge.recovery_hint(True) == "'arm clear_fault'"
