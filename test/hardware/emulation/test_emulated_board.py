import math

import numpy as np
import pytest

from aerarm_ros.description.drive_config import MotorConfig
from aerarm_ros.hardware.emulation.emulated_board import EmulatedBoard, EmulatedSupply
from aerarm_ros.hardware.emulation.emulated_motor import AlignmentTiming
from aerarm_ros.hardware.frames.board_messages import BoardCommand
from aerarm_ros.hardware.frames.frame_codec import FrameCodec
from aerarm_ros.hardware.frames.frame_profile import load_profile

SUBSTEP = 0.25e-3
MOTOR = MotorConfig('MN4006', 12, 380.0, 16.0, 1.3e-5, 0.15)
TIMING = AlignmentTiming(0.05, 0.05, 0.01)


class BoardBench:
    """A board with two free rotors, light enough to follow any field."""

    def __init__(self, profile='uomodri_v3', **options):
        profile = load_profile(profile)
        self.codec = FrameCodec(profile)
        self.board = EmulatedBoard(profile, [MOTOR, MOTOR], SUBSTEP, alignment=TIMING, **options)
        self.command = BoardCommand(current_saturation=[5.0, 5.0])
        self.angles = [0.0, 0.0]
        self.held = True
        self.index = 0

    def cycle(self, send=True):
        """Run a millisecond and exchange a frame; return the state, None if it was bad."""
        for _ in range(4):
            self.board.step(*self.angles)
            if not self.held:
                for i, motor in enumerate(self.board.motors):
                    self.angles[i] += 0.003 * motor.torque_current
        if not send:
            return None
        self.index += 1
        self.command.index = self.index
        return self.codec.decode(self.board.exchange(self.codec.encode(self.command)))

    def cycles(self, count, **options):
        for _ in range(count):
            state = self.cycle(**options)
        return state

    def enabled(self):
        self.command.enable_system = True
        self.command.enable_motor = [True, True]
        self.held = False
        self.cycles(130)
        self.held = True
        state = self.cycle()
        assert state.motor_ready == [True, True], state
        return self


def test_reports_measurements_with_noise_on_the_current_only():
    bench = BoardBench().enabled()
    bench.command.current = [1.0, -2.0]
    currents = []
    for _ in range(300):
        state = bench.cycle()
        currents.append(state.current)
    currents = np.array(currents[20:])
    assert currents.mean(axis=0) == pytest.approx([1.0, -2.0], abs=0.01)
    assert currents.std(axis=0) == pytest.approx([0.02, 0.02], rel=0.3)
    assert state.position == pytest.approx(bench.angles, abs=2 * math.pi / 4096)
    assert state.coil_resistance == pytest.approx([0.15, 0.15], abs=1e-4)


@pytest.mark.parametrize('profile', ['uomodri_v3', 'udriver_v2'])
def test_bad_frames_are_ignored_and_the_last_command_remains_active(profile):
    bench = BoardBench(profile).enabled()
    bench.command.current = [1.0, 1.0]
    bench.cycle()
    good = bench.codec.encode(bench.command)
    for _ in range(10):
        bench.cycle(send=False)
        bench.board.exchange(good[:20] + b'\x55' + good[21:])
    assert bench.board.motors[0].torque_current == pytest.approx(1.0, abs=1e-3)
    assert bench.codec.decode(bench.board.exchange(good)).index == bench.index


def test_silence_without_current_is_no_error():
    bench = BoardBench().enabled()
    bench.command.timeout = 0.005
    bench.cycles(10)
    bench.cycles(50, send=False)
    assert bench.board.error == 0


def test_the_first_error_stays():
    board = BoardBench().board
    board.raise_error(3)
    board.raise_error(7)
    assert board.error == 3


def test_saturation_of_the_command_is_kept_and_never_above_the_motors():
    bench = BoardBench().enabled()
    bench.command.current, bench.command.current_saturation = [30.0, 30.0], [2.0, 25.0]
    bench.cycles(20)
    assert bench.board.motors[0].torque_current == pytest.approx(2.0)
    assert bench.board.motors[1].torque_current == pytest.approx(MOTOR.current_max)


def test_a_motor_that_left_its_128_turns_stops_the_board():
    bench = BoardBench().enabled()
    bench.angles[1] = 129 * 2 * math.pi
    assert bench.cycle().error == 5


def test_a_prepared_frame_shows_the_board_as_it_was_then():
    bench = BoardBench().enabled()
    bench.board.prepare()
    bench.angles = [0.5, -0.5]
    for _ in range(4):
        bench.board.step(*bench.angles)
    frame = bench.codec.encode(bench.command)
    before = bench.codec.decode(bench.board.exchange(frame))
    after = bench.codec.decode(bench.board.exchange(frame))
    assert after.position[0] - before.position[0] > 0.4
    assert after.timestamp > before.timestamp


def test_an_error_after_a_frame_was_prepared_is_in_it():
    bench = BoardBench().enabled()
    bench.board.prepare()
    bench.board.raise_error(7)
    state = bench.codec.decode(bench.board.exchange(bench.codec.encode(bench.command)))
    assert state.error == 7
    assert not state.system_enabled


def test_a_battery_sags_under_a_load_and_takes_braking_power_back():
    supply = EmulatedSupply()
    supply.step(240.0, 1e-3)
    assert supply.voltage == pytest.approx(24.0 - 0.05 * 10.0)
    supply.step(-240.0, 1e-3)
    assert supply.voltage == pytest.approx(24.5)


def test_braking_energy_that_the_supply_rejects_charges_the_capacitors():
    supply = EmulatedSupply()
    supply.capacitance = 1e-3
    for _ in range(100):
        supply.step(-10.0, 1e-3)
    assert supply.voltage == pytest.approx(math.sqrt(24.0**2 + 2.0 * 1.0 / 1e-3))
    for _ in range(200):
        supply.step(10.0, 1e-3)  # motors take it again first
    assert supply.voltage == pytest.approx(24.0, abs=0.1)
