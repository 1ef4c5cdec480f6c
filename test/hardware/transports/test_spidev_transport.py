import importlib.util
from dataclasses import replace

import pytest

from aerarm_ros.hardware.transports.spidev_transport import SpidevTransport, TransportError

HAS_SPIDEV = importlib.util.find_spec('spidev') is not None


def nowhere(config):
    board = replace(config.boards[0], device='/dev/spidev77.7')
    return replace(config, boards=(board, config.boards[1]))


@pytest.mark.skipif(HAS_SPIDEV, reason='the module spidev is installed')
def test_without_spidev_the_error_states_what_to_install(config):
    with pytest.raises(TransportError, match=r'pip install "aerarm_ros\[spi\]"'):
        SpidevTransport(config).open()


@pytest.mark.skipif(not HAS_SPIDEV, reason='the module spidev is not installed (extra spi)')
def test_without_the_device_the_error_states_what_to_check(config):
    with pytest.raises(TransportError, match='/dev/spidev77.7 of board0 cannot be opened'):
        SpidevTransport(nowhere(config)).open()


def test_exchanges_on_a_closed_bus_give_nothing_and_a_reason(config):
    transport = SpidevTransport(nowhere(config))
    assert transport.exchange(0, bytes(34)) == b''
    assert 'not open' in transport.problem(0)
    assert transport.exchange_time(0) < 1.0
    transport.close()
    transport.close()
