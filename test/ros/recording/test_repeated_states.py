from aerarm_ros.ros.recording import RepeatedStates


def test_finds_what_was_said_before() -> None:
    states = RepeatedStates()
    heard = [b'a', b'a', b'b', b'b', b'b', b'a']
    assert [states.has(payload) for payload in heard] == [False, True, False, True, True, False]
    assert states.count == 3
    assert states.last == b'a'
