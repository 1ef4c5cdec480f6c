from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import REJECTIONS, CommandIntake
from aerarm_ros.ros.bridge.bridge_diagnostics import RejectionLog

PERIOD = 1e-3
TWO = 'joint_command has 2 publishers (/a, /b)'
SAID = {reason: f'a command was rejected: {text}' for reason, text in REJECTIONS.items()}


class Cycle:
    """An intake that rejects, and the log of it."""

    def __init__(self) -> None:
        self.warning = ''
        self.intake = CommandIntake(['joint1'], BridgeSettings())
        self.lines: list[str] = []
        self.rejections = RejectionLog(self.lines.append, lambda: self.warning)

    def run(self, begin: float, seconds: float, reason: str = '', mode: str = 'running') -> None:
        for index in range(round(seconds / PERIOD)):
            now = begin + index * PERIOD
            if reason:
                self.intake.reject(reason, now)
            self.rejections.update(self.intake, mode, now)


def test_each_reason_is_one_warning_when_it_begins_and_at_most_every_ten_seconds() -> None:
    cycle = Cycle()
    cycle.run(100.0, 30.0, 'nan')
    cycle.run(130.0, 1.0, 'length')
    assert cycle.lines == [SAID['nan'], SAID['length']]
    for begin in (133.0, 136.0, 143.0):
        cycle.run(begin, 1.0, 'length')
    assert cycle.lines[2:] == [SAID['length']]


def test_publishers_that_are_found_a_little_later_are_named() -> None:
    cycle = Cycle()
    cycle.run(100.0, 0.1, 'source')
    assert cycle.lines == []
    cycle.warning = TWO
    cycle.run(100.1, 0.1, 'source')
    assert cycle.lines == [f'a command was rejected: {TWO}']
    cycle.warning = ''
    cycle.run(200.0, 1.0, 'source')
    assert cycle.lines[1:] == [SAID['source']]


def test_commands_in_transit_when_the_arm_stops_are_not_logged() -> None:
    cycle = Cycle()
    cycle.run(100.0, 1.0)
    cycle.run(101.0, 0.1, 'not_ready', mode='fault')
    cycle.run(102.0, 0.1, 'nan', mode='fault')
    assert cycle.lines == [SAID['nan']]
    cycle.run(103.0, 1.0, 'not_ready', mode='fault')
    assert cycle.lines[1:] == [SAID['not_ready']]


def test_a_single_rejection_of_an_unknown_publisher_is_logged_after_a_while() -> None:
    cycle = Cycle()
    cycle.run(100.0, PERIOD, 'source')
    cycle.run(100.0 + PERIOD, 0.3)
    assert cycle.lines == []
    cycle.run(100.0 + PERIOD + 0.3, 0.3)
    assert cycle.lines == [SAID['source']]
