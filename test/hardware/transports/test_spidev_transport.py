import importlib.util
from dataclasses import replace

import pytest

from aerarm_ros.hardware.transports.spidev_transport import SpidevTransport, TransportError


@pytest.fixture
def transport(config):
    board = replace(config.boards[0], device='/dev/spidev77.7')
    return SpidevTransport(replace(config, boards=(board, config.boards[1])))


def test_without_spidev_the_error_states_what_to_install(transport, monkeypatch):
    monkeypatch.setattr(importlib.util, 'find_spec', lambda name: None)
    with pytest.raises(TransportError, match=r'pip install "spidev>=3.5,<4"'):
        transport.open()


def test_exchanges_on_a_closed_bus_give_nothing_and_a_reason(transport):
    assert transport.exchange(0, bytes(34)) == b''
    assert 'not open' in transport.problem(0)
    assert transport.exchange_time(0) < 1.0
    transport.close()
    transport.close()
