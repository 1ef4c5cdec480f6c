import pytest

from aerarm_ros.hardware.emulation.fault_injection import FAULTS, FaultInjectionError, FaultRequest


@pytest.mark.parametrize(
    ('text', 'request_'),
    [
        ('dead_board', FaultRequest('dead_board')),
        ('bit_errors:1', FaultRequest('bit_errors', 1)),
        ('stuck_encoder:0:1', FaultRequest('stuck_encoder', 0, 1)),
        (' encoder_jump:1:0:-0.5 ', FaultRequest('encoder_jump', 1, 0, -0.5)),
    ],
)
def test_short_and_long_forms(text, request_):
    assert FaultRequest.parse(text, 2) == request_


@pytest.mark.parametrize(
    ('text', 'hint'),
    [
        ('gremlins', 'choose one of bit_errors'),
        ('', 'choose one of'),
        ('dead_board:2', 'boards 0 to 1'),
        ('stuck_encoder:0:2', 'motors 0 and 1'),
        ('dead_board:one', r'NAME\[:BOARD'),
        ('slow_bus:0:0:much', r'NAME\[:BOARD'),
        ('slow_bus:0:0:nan', r'NAME\[:BOARD'),
        ('slow_bus:0:0:0.1:5', r'NAME\[:BOARD'),
        ('slow_bus:0:0:-1', 'value -1 of slow_bus must lie in 0 .. 1'),
        ('bit_errors:0:0:2', 'value 2 of bit_errors must lie in 0 .. 1'),
        ('dead_board:0:0:1', 'dead_board takes no VALUE'),
    ],
)
def test_invalid_faults_raise_an_error_with_the_reason(text, hint):
    with pytest.raises(FaultInjectionError, match=hint):
        FaultRequest.parse(text, 2)


def test_every_fault_can_be_applied(make_rig):
    for name in FAULTS:
        FaultRequest(name, 1).apply(make_rig().boards)
