"""PX4 and ArduCopter, replayed from recordings that check the received data."""

import json
import socket
import struct
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from firmware_recording import (
    ARDUPILOT,
    BODY,
    DRONE,
    FLOWN,
    PX4,
    STILL,
    Replay,
    flight,
    fly,
    known_frames,
    steps_of,
    tap,
)

from aerarm_ros.autopilot import ardupilot_flight, px4_flight
from aerarm_ros.autopilot.ardupilot import motors_of
from aerarm_ros.autopilot.ardupilot_flight import (
    ArduPilotFirmware,
    JsonLink,
    motor_shares,
    sensor_line,
)
from aerarm_ros.autopilot.firmware_flight import (
    FirmwareFlight,
    FlightStage,
    LockstepFirmware,
    companion_line,
)
from aerarm_ros.autopilot.mavlink import FrameReader
from aerarm_ros.autopilot.px4 import GPS, VISION, ned
from aerarm_ros.autopilot.px4_flight import Px4Firmware, SensorFrames, SimulatorLink
from aerarm_ros.description.drone_config import GRAVITY
from aerarm_ros.flight.arm_load import FeedForward
from aerarm_ros.flight.flight_state import FlightState, FlightTarget

TARGET = FlightTarget.here(STILL)
NAMES = {PX4: 'PX4', ARDUPILOT: 'ArduPilot'}
both = pytest.mark.parametrize('name', [PX4, ARDUPILOT])

Stage = Callable[..., tuple[LockstepFirmware, FirmwareFlight, Replay]]


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(('127.0.0.1', 0))
        return int(probe.getsockname()[1])


def firmware_of(name: str, sensors: str = VISION) -> tuple[LockstepFirmware, tuple[int, int, int]]:
    """Return a firmware, and the ports of simulator, companion and PX4."""
    if name == ARDUPILOT:
        ports = free_port(), free_port(), 0
        line = companion_line(ports[1])
        return ArduPilotFirmware(JsonLink(ports[0]), line, motors_of(DRONE), sensors), ports
    ports = free_port(socket.SOCK_STREAM), free_port(), free_port()
    return Px4Firmware(SimulatorLink(ports[0]), companion_line(*ports[1:]), sensors), ports


@pytest.fixture
def staged() -> Iterator[Stage]:
    """Return a function that starts a replayed firmware and its connections."""
    started = []

    def start(name: str, **faults: float) -> tuple[LockstepFirmware, FirmwareFlight, Replay]:
        firmware, ports = firmware_of(name)
        replay = Replay(name, *ports, **faults)
        replay.start()
        started.append(firmware)
        return firmware, flight(firmware), replay

    yield start
    for firmware in started:
        firmware.close()


def shorten_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(px4_flight, '_ANSWER', 0.2)
    monkeypatch.setattr(ardupilot_flight, '_PATIENCE', 0.2)


@both
def test_the_firmware_is_led_into_the_air_as_it_was_when_recorded(
    name: str, staged: Stage, monkeypatch
) -> None:
    firmware, control, replay = staged(name)
    assert 'no answer from' in control.problem
    assert 'before this node' in control.problem
    seen = fly(control)
    replay.join(20.0)
    assert replay.differing == []  # byte by byte, in both directions
    assert replay.done == len(replay.steps)
    assert control.problem == ''
    stages = 'estimator is settling', 'is arming', 'rotors are spooling up'
    found = [stage for text in seen for stage in stages if stage in text.partition(';')[0]]
    assert list(dict.fromkeys(found)) == list(stages)
    thrust = control.update(STILL, TARGET, 0.0)
    assert thrust.shape == (DRONE.n,)
    assert 0.5 < thrust.sum() / (BODY.mass * GRAVITY) < 2.0
    # The recording ends in flight, and so does this firmware.
    shorten_waits(monkeypatch)
    control.update(STILL, TARGET, 0.004)
    assert firmware.is_lost
    assert control.problem == f'{NAMES[name]} has ended: restart {NAMES[name]} and this node'


@both
def test_a_firmware_that_ends_on_the_ground_is_named(name: str, staged: Stage, monkeypatch) -> None:
    shorten_waits(monkeypatch)
    _, control, replay = staged(name, ends_at=300)
    fly(control, flown=0)
    assert f'{NAMES[name]} has ended' in control.problem
    replay.join(5.0)
    assert replay.done == 300


@both
def test_a_simulator_that_ends_ends_the_exchange(name: str, staged: Stage) -> None:
    firmware, control, replay = staged(name, patience=0.5)
    control.update(STILL, TARGET, 0.004)
    firmware.close()
    replay.join(20.0)
    assert not replay.is_alive()
    assert replay.done < 10


def test_a_damaged_answer_is_counted_and_the_thrust_before_it_holds(
    staged: Stage, monkeypatch
) -> None:
    firmware, control, replay = staged(PX4)
    air = len(replay.steps) - FLOWN  # the first step in the air
    replay._damaged = air + 20
    fly(control, flown=20)
    before = control.update(STILL, TARGET, 0.0)
    monkeypatch.setattr(px4_flight, '_ANSWER', 0.2)
    after = control.update(STILL, TARGET, 0.004)
    np.testing.assert_array_equal(after, before)
    assert firmware._simulator.damaged == 1
    assert replay.done == air + 21
    assert control.problem == ''


@both
def test_a_recording_of_the_replay_is_the_recording(name: str, staged: Stage) -> None:
    firmware, control, replay = staged(name, ends_at=500)
    notes = tap(firmware)
    control.update(STILL, TARGET, 0.004)
    while replay.done < 300:
        control.settle()
    _, steps = steps_of(notes, 1 if name == PX4 else 4)

    def frames(these: list) -> list[str]:
        data = [bytes.fromhex(x) for step in these for x in (*step.early, *step.late)]
        return [frame.hex() for one in data for frame in known_frames(one)]

    for found, expected in zip(steps[20:200], replay.steps[20:200], strict=True):
        assert (found.sent, found.companion) == (expected.sent, expected.companion)
        assert found.answers == expected.answers
    assert frames(steps[:200])[-20:] == frames(replay.steps[:200])[-20:]


@pytest.mark.parametrize('sensors', [VISION, GPS])
@both
def test_with_gps_the_set_points_are_in_the_frame_of_the_firmware(
    name: str, sensors: str, monkeypatch
) -> None:
    firmware, _ = firmware_of(name, sensors)
    here, off = STILL._replace(position=np.array([1.0, 2.0, 0.5])), np.array([0.03, -0.04, 0.05])
    off *= 100.0 if sensors == GPS else 1.0
    sent: dict[str, dict] = {}
    monkeypatch.setattr(firmware, 'send', lambda name, **values: sent.update({name: values}))
    monkeypatch.setattr(firmware, '_held_step', lambda state: None)
    firmware.stage, firmware._place = FlightStage.SETTLE, ned(here.position) + off
    for _ in range(2):
        firmware.hold(here, 1.0)
        firmware._time += 4.0 * firmware._second
    assert firmware.stage is FlightStage.ARM
    assert ('SET_GPS_GLOBAL_ORIGIN' in sent) == (name == ARDUPILOT and sensors == VISION)
    flight(firmware)._lead(here, FlightTarget.here(here), 0.0, FeedForward.at_rest(BODY))
    target = sent['SET_POSITION_TARGET_LOCAL_NED']
    expected = ned(here.position) + (off if sensors == GPS else 0.0) - [0.0, 0.0, firmware.rise]
    np.testing.assert_allclose([target[axis] for axis in 'xyz'], expected)
    # ArduPilot receives its odometry as a companion's message; PX4 with its other sensors.
    frames: list[bytes] = []
    monkeypatch.setattr(firmware._companion, 'send', frames.append)
    firmware.step(here, 0.004)
    names = [message.name for message in FrameReader().feed(b''.join(frames))]
    assert ('ODOMETRY' in names) == (name == ARDUPILOT and sensors == VISION)
    firmware.close()


def test_px4_receives_its_position_as_odometry_or_from_satellites() -> None:
    place, velocity = np.array([30.0, 40.0, 5.0]), np.array([3.0, 4.0, 2.0])
    moving = STILL._replace(position=place, velocity=velocity)
    for sensors, name, count in ((VISION, 'ODOMETRY', 50), (GPS, 'HIL_GPS', 2)):
        frames = SensorFrames(sensors)
        data = b''.join(b''.join(frames.frames(4000 * (i + 1), moving)) for i in range(51))
        found = [message for message in FrameReader().feed(data) if message.name != 'HIL_SENSOR']
        assert [message.name for message in found] == [name] * count
    one = found[-1]
    assert one['time_usec'] == 4000 * 50
    degree = np.radians(6.371e6)  # [m] on a meridian
    north, east = degree * (1e-7 * np.array([one['lat'], one['lon']]) - [47.397742, 8.545594])
    found_place = [east * np.cos(np.radians(47.397742)), north, 1e-3 * one['alt'] - 488.0]
    np.testing.assert_allclose(found_place, place, atol=0.1)
    np.testing.assert_allclose([one['vn'], one['ve'], one['vd']], [400, 300, -200], atol=10)
    assert one['vel'] == pytest.approx(500, abs=10)
    nowhere = SensorFrames(GPS)
    data = b''.join(b''.join(nowhere.frames(4000 * i, moving, is_placed=False)) for i in range(51))
    assert {message.name for message in FrameReader().feed(data)} == {'HIL_SENSOR'}


@pytest.mark.parametrize(
    ('kind', 'link'), [('TCP', SimulatorLink), ('UDP', JsonLink), ('UDP', companion_line)]
)
def test_a_taken_port_is_named(kind: str, link: Callable[[int], object]) -> None:
    port = free_port(socket.SOCK_STREAM if kind == 'TCP' else socket.SOCK_DGRAM)
    first = link(port)
    with pytest.raises(ValueError, match=f'{kind} port {port}.*autopilot_instance'):
        link(port)
    first.close()


def test_a_sensor_line_of_ardupilot_is_north_east_down() -> None:
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # to the north
    place, velocity = np.array([1.0, 2.0, 1.5]), np.array([0.1, 0.2, 0.3])
    state = FlightState(place, velocity, turned, np.array([0.4, 0.5, 0.6]))
    values = json.loads(sensor_line(2.5, state))
    assert values['timestamp'] == 2.5
    np.testing.assert_allclose(values['position'], [2.0, 1.0, -1.5])
    np.testing.assert_allclose(values['velocity'], [0.2, 0.1, -0.3])
    np.testing.assert_allclose(values['imu']['gyro'], [0.4, -0.5, -0.6])
    np.testing.assert_allclose(values['imu']['accel_body'], [0.0, 0.0, -GRAVITY])
    np.testing.assert_allclose(np.abs(values['quaternion']), [1.0, 0.0, 0.0, 0.0], atol=1e-9)


def test_other_packets_are_no_motors_of_ardupilot() -> None:
    packet = struct.pack('<HHI16H', 18458, 400, 7, *[1250] * 16)
    number, shares = motor_shares(packet)
    assert number == 7
    np.testing.assert_allclose(shares, 0.25)
    assert motor_shares(b'\0\0' + packet[2:]) is None
    assert motor_shares(packet[:-1]) is None
