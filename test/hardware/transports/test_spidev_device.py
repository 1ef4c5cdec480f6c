"""Search for a missing device; for the transfers see test_spidev_bus.py."""

import errno
import sys

import pytest

from aerarm_ros.hardware.transports.spidev_transport import SpidevDevice, TransportError

FRAME = bytes(34)


class Driver:
    """Replacement of the module spidev, with devices set by the test."""

    def __init__(self) -> None:
        self.error = 0  # of every transfer
        self.is_there = True
        self.opened: list[float] = []
        self.attempts: list[float] = []
        self.closed = 0
        self.now = 0.0

    def SpiDev(self) -> 'Driver.File':  # noqa: N802 (the module's own name)
        return self.File(self)

    class File:
        def __init__(self, driver: 'Driver') -> None:
            self.driver = driver
            self.is_open = False

        def open_path(self, path: str) -> None:
            self.driver.attempts.append(self.driver.now)
            if not self.driver.is_there:
                raise FileNotFoundError(errno.ENOENT, 'No such file or directory', path)
            self.is_open = True
            self.driver.opened.append(self.driver.now)

        def xfer2(self, frame: bytes) -> list[int]:
            assert self.is_open
            if self.driver.error:
                raise OSError(self.driver.error, 'the reason')
            return list(frame)

        def close(self) -> None:
            self.driver.closed += self.is_open
            self.is_open = False


@pytest.fixture
def driver(monkeypatch):
    driver = Driver()
    monkeypatch.setitem(sys.modules, 'spidev', driver)
    return driver


@pytest.fixture
def device(config, driver):
    device = SpidevDevice(config.boards[0], lambda: driver.now)
    device.open()
    return device


def run(device, driver, seconds):
    """Transfer one frame per millisecond; return the number of answers."""
    good = 0
    for _ in range(round(seconds * 1000)):
        driver.now += 1e-3
        good += device.transfer(FRAME) == FRAME
    return good


def test_one_error_does_not_close_the_file(device, driver):
    driver.error = errno.EIO
    assert run(device, driver, 0.1) == 0
    assert 'reports an error (the reason)' in device.problem
    driver.error = 0
    assert run(device, driver, 0.1) == 100
    assert device.problem == ''
    assert len(driver.opened) == 1


@pytest.mark.parametrize('error', [errno.ESHUTDOWN, errno.ENODEV, errno.EIO])
def test_a_removed_device_is_reopened_after_increasing_waits(device, driver, error):
    driver.error, driver.is_there = error, False
    assert run(device, driver, 30.0) == 0
    assert driver.closed == 1
    waits = [b - a for a, b in zip(driver.attempts[1:], driver.attempts[2:], strict=False)]
    assert waits[:5] == pytest.approx([0.4, 0.8, 1.6, 3.2, 5.0], abs=0.002)
    assert waits[5:] == pytest.approx([5.0] * len(waits[5:]), abs=0.002)
    assert 'again every 5 s' in device.problem
    driver.error, driver.is_there = 0, True
    assert run(device, driver, 5.1) > 0
    assert device.problem == ''
    # The next loss is looked after as soon as the first was.
    driver.error = errno.ESHUTDOWN
    run(device, driver, 0.001)
    driver.error = 0
    assert run(device, driver, 0.25) > 40


def test_a_device_that_is_there_and_gives_errors_is_not_opened_all_the_time(device, driver):
    driver.error = errno.ESHUTDOWN
    run(device, driver, 30.0)
    assert len(driver.opened) < 12
    assert driver.closed >= len(driver.opened) - 1  # no file is left open


def test_closed_it_stays_closed(device, driver):
    device.close()
    assert run(device, driver, 10.0) == 0
    assert len(driver.opened) == 1
    assert 'not open' in device.problem
    with pytest.raises(OSError, match='not open'):
        device.set_mode(1)


def test_time_and_duration_of_a_transfer_are_stored(device, driver):
    ticks = iter([1.0, 1.25])
    device._clock = lambda: next(ticks)
    device.transfer(FRAME)
    assert (device.duration, device.ended) == (0.25, 1.25)


def test_a_device_that_cannot_be_opened_raises_an_error_with_a_remedy(config, driver):
    driver.is_there = False
    with pytest.raises(TransportError, match='/dev/spidev0.0 of board0 cannot be opened'):
        SpidevDevice(config.boards[0]).open()
