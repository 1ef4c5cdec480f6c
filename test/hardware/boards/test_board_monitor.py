import pytest

from aerarm_ros.hardware.boards.board_monitor import BoardMode, BoardMonitor
from aerarm_ros.hardware.frames.board_messages import BoardState
from aerarm_ros.hardware.frames.frame_profile import load_profile
from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings

SETTINGS = BridgeSettings()


class Wire:
    """Feeds a monitor with the frames of a board."""

    def __init__(self, profile='uomodri_v3', channels=(0, 1), settings=SETTINGS):
        self.monitor = BoardMonitor('board0', load_profile(profile), channels, settings)
        self.state = BoardState()
        self.now = 0.0

    def good(self, count=1, enable=False, running=False, frozen=False, **changes):
        for name, value in changes.items():
            setattr(self.state, name, value)
        for _ in range(count):
            self.now += 1e-3
            if not frozen:
                self.state.timestamp = self.now
            self.monitor.received(self.state, self.now, enable, running)
        return self.monitor.mode

    def bad(self, count=1, problem='', enable=False):
        for _ in range(count):
            self.now += 1e-3
            self.monitor.missed(enable, problem)
        return self.monitor.mode

    def ready(self):
        self.good(5)
        self.good(enable=True, system_enabled=True, motor_enabled=[True, True])
        assert self.good(enable=True, motor_ready=[True, True]) is BoardMode.READY
        return self


def test_a_board_passes_through_all_modes_to_running_and_back():
    wire = Wire()
    assert wire.monitor.mode is BoardMode.DISCONNECTED
    assert wire.good(4) is BoardMode.DISCONNECTED
    assert wire.good() is BoardMode.IDLE
    assert wire.good(enable=True) is BoardMode.ALIGNING
    wire.good(enable=True, system_enabled=True, motor_enabled=[True, True])
    assert wire.monitor.mode is BoardMode.ALIGNING
    assert wire.good(enable=True, motor_ready=[True, False]) is BoardMode.ALIGNING
    assert wire.good(enable=True, motor_ready=[True, True]) is BoardMode.READY
    assert wire.good(enable=True, running=True) is BoardMode.RUNNING
    assert wire.good(enable=True, running=False) is BoardMode.READY
    assert wire.good(enable=False) is BoardMode.IDLE


def test_a_board_is_connected_after_several_consecutive_good_answers():
    wire = Wire()
    wire.good(4)
    wire.bad()
    assert wire.good(4) is BoardMode.DISCONNECTED
    assert wire.good() is BoardMode.IDLE
    assert Wire().good(5, enable=True) is BoardMode.ALIGNING


def test_a_cleared_board_is_disconnected_if_silent_and_in_fault_if_lost_while_enabled():
    wire = Wire().ready()
    wire.monitor.fail('of the test')
    assert wire.monitor.clear(wire.state) == ''
    assert wire.bad(10, enable=True) is BoardMode.FAULT
    assert wire.monitor.clear(wire.state) == ''
    assert wire.monitor.fault == ''
    assert wire.monitor.mode is BoardMode.DISCONNECTED


def test_a_cut_command_wire_is_a_fault_while_the_board_is_enabled():
    wire = Wire()
    wire.good(5)
    for index in range(1, 20):
        wire.good(index=0)
        wire.monitor.sent(index)
    assert wire.monitor.echo.lost == wire.monitor.counters()['lost commands'] == 17
    assert wire.monitor.mode is BoardMode.IDLE
    assert wire.good(enable=True, index=0) is BoardMode.FAULT
    assert wire.monitor.fault == f'board0: {wire.monitor.echo.fault}'
    assert wire.monitor.clear(wire.state) == wire.monitor.echo.warning != ''
    wire.bad(10)  # a silent board may be cleared
    assert wire.monitor.clear(wire.state) == ''


def test_single_bad_frames_are_counted_only():
    wire = Wire().ready()
    for _ in range(20):
        wire.bad(5)
        assert wire.good(enable=True) is BoardMode.READY
    assert wire.monitor.bad_frames == wire.monitor.counters()['bad frames'] == 100
    assert wire.monitor.counters()['good frames'] == 7 + 20


@pytest.mark.parametrize(
    ('problem', 'text'),
    [
        ('', 'no frame with a correct check: check supply, wires and SPI mode'),
        *[('/dev/spidev0.0 reports: Input/output error',) * 2],
    ],
)
def test_too_many_bad_frames_are_a_fault_that_stays(problem, text):
    wire = Wire()
    assert wire.monitor.is_silent
    wire.ready()
    assert wire.bad(9) is BoardMode.READY
    assert not wire.monitor.is_silent
    assert wire.bad(problem=problem) is BoardMode.FAULT
    assert wire.monitor.is_silent
    assert wire.monitor.fault == f'board0: 10 consecutive frames were bad, {text}'
    assert wire.monitor.problem == (problem or 'check supply, wires and SPI mode')
    assert wire.good(enable=True) is BoardMode.FAULT
    assert wire.monitor.clear(wire.state) == ''
    assert wire.good(enable=True) is BoardMode.READY


def test_before_the_first_answer_the_problem_states_what_to_check():
    wire = Wire()
    assert wire.monitor.problem == 'check supply, wires and SPI mode'
    wire.bad(problem='/dev/spidev0.0 is gone')
    wire.monitor.missed()
    assert wire.monitor.problem == 'check supply, wires and SPI mode'
    assert wire.monitor.mode is BoardMode.DISCONNECTED


def test_time_without_exchanges_does_not_count_as_silence():
    wire = Wire().ready()
    for _ in range(20):
        wire.now += 0.25
        assert wire.bad(9) is BoardMode.READY
        wire.now += 0.25
        assert wire.good(enable=True) is BoardMode.READY


def test_data_that_had_no_time_to_change_is_not_frozen():
    wire = Wire().ready()
    for _ in range(20):
        wire.now += 0.25
        assert wire.good(9, enable=True, frozen=True) is BoardMode.READY
        wire.good(enable=True)


def test_a_board_lost_while_it_is_enabled_is_a_fault():
    wire = Wire()
    wire.good(5)
    assert wire.bad(10, enable=True) is BoardMode.FAULT


def test_a_board_that_is_off_may_go_and_come():
    wire = Wire()
    wire.good(5)
    for _ in range(10):
        wire.monitor.missed()  # nothing was enabled
    assert wire.monitor.mode is BoardMode.DISCONNECTED
    assert wire.good(5) is BoardMode.IDLE
    assert wire.monitor.clear(wire.state) == ''
    assert wire.monitor.fault == ''


@pytest.mark.parametrize('code', [1, 2, 3, 5, 6, 7, 15])
def test_error_codes_are_faults_with_their_text(code):
    wire = Wire().ready()
    assert wire.good(enable=True, error=code) is BoardMode.FAULT
    assert f'error {code}' in wire.monitor.fault
    assert 'power-cycle' in wire.monitor.fault


def test_a_fault_whose_cause_is_there_cannot_be_cleared():
    wire = Wire().ready()
    wire.good(enable=True, error=7)
    assert 'error 7' in wire.monitor.clear(wire.state)
    assert wire.monitor.mode is BoardMode.FAULT
    wire.good(error=0)
    assert wire.monitor.clear(wire.state) == ''
    assert wire.monitor.mode is BoardMode.IDLE


def test_a_board_that_restarts_is_a_fault():
    wire = Wire().ready()
    off = {'system_enabled': False, 'motor_enabled': [False] * 2, 'motor_ready': [False] * 2}
    assert wire.good(enable=True, **off) is BoardMode.FAULT
    assert wire.monitor.fault == (
        'board0: the board no longer drives its motors: check its supply, because it may '
        'have restarted'
    )


def test_alignment_may_not_take_for_ever():
    wire = Wire()
    wire.good(5)
    assert wire.good(6000, enable=True) is BoardMode.ALIGNING
    assert wire.good(10, enable=True) is BoardMode.FAULT
    assert wire.monitor.fault == (
        'board0: the motors of the board are not aligned after 6 s: support the arm, check the '
        'motor cables, and enable again'
    )
    # Cleared, it has as long again.
    assert wire.monitor.clear(wire.state) == ''
    assert wire.good(5000, enable=True) is BoardMode.ALIGNING


def test_frozen_data_is_a_fault():
    wire = Wire().ready()
    assert wire.good(15, enable=True, frozen=True) is BoardMode.READY
    assert wire.good(10, enable=True, frozen=True) is BoardMode.FAULT
    assert wire.monitor.fault == (
        'board0: frames are correct but their data is frozen: power-cycle the board'
    )


def test_data_is_frozen_after_ten_identical_answers_of_a_certain_age():
    wire = Wire()
    wire.good(5)
    wire.now += 1.0  # old by the tenth
    assert wire.good(9, frozen=True) is BoardMode.IDLE
    assert wire.good(frozen=True) is BoardMode.FAULT


def test_slow_exchanges_are_counted_and_many_in_a_row_are_a_fault():
    monitor = Wire().ready().monitor
    for _ in range(9):
        monitor.slow(0.002)
    monitor.slow(0.0005)
    assert monitor.mode is BoardMode.READY
    assert monitor.slow_exchanges == 9
    for _ in range(10):
        monitor.slow(0.002)
    assert monitor.mode is BoardMode.FAULT
    fault = (
        'board0: exchanges take 2.00 ms, above the limit of 0.50 ms: check clock_hz, and '
        'polling_limit_us of the SPI driver'
    )
    assert monitor.clear(BoardState()) == monitor.fault == fault
    monitor.slow(0.0001)
    assert monitor.clear(BoardState()) == ''
    for _ in range(9):
        monitor.slow(0.002)
    assert monitor.mode is not BoardMode.FAULT
