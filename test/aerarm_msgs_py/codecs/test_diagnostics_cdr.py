import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import serialize_message

from aerarm_msgs_py.codecs.cdr import diagnostic_values


def test_values_by_status() -> None:
    statuses = [
        DiagnosticStatus(
            name=name,
            level=bytes([level]),
            message='m' * level,
            values=[KeyValue(key=f'k{i}', value='v' * i) for i in range(level)],
        )
        for level, name in enumerate(('a', 'bb', 'ccc'))
    ]
    payload = serialize_message(DiagnosticArray(status=statuses))
    assert diagnostic_values(payload) == {'a': {}, 'bb': {'k0': ''}, 'ccc': {'k0': '', 'k1': 'v'}}


def test_a_truncated_message_is_rejected() -> None:
    payload = serialize_message(DiagnosticArray(status=[DiagnosticStatus(name='a')]))
    with pytest.raises(ValueError, match='ends too early'):
        diagnostic_values(payload[:-6])
