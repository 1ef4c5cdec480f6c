"""Each state is processed once; its answers are republished when the state is re-sent."""

import pytest

from aerarm_ros.ros.states.state_stream import Answers


class Wire:
    """A publisher whose messages are kept."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def publish(self, message: bytes) -> None:
        self.sent.append(message)


@pytest.fixture
def wire() -> Wire:
    return Wire()


def test_re_sent_states_are_detected() -> None:
    answers = Answers(needed=False)
    states = [b'a', b'a', b'b', b'b', b'b', b'a']
    assert [answers.begin(state) for state in states] == [False, True, False, True, True, False]
    assert answers.count == 3
    assert answers.state == b'a'


def test_a_resent_state_has_the_same_answer(wire: Wire) -> None:
    answers = Answers()
    answers.begin(b'a')
    assert not answers.again()
    answers.publish(wire, b'1')
    answers.begin(b'a')
    assert answers.again()
    assert wire.sent == [b'1', b'1']
    answers.begin(b'b')
    assert not answers.again()
    assert wire.sent == [b'1', b'1']


def test_an_unanswered_re_sent_state_is_returned_again(wire: Wire) -> None:
    answers = Answers()
    answers.begin(b'a')
    answers.publish(wire, b'1')
    answers.begin(b'b')
    answers.begin(b'b')
    assert not answers.again()
    assert wire.sent == [b'1']


def test_an_answered_state_is_not_returned_twice(wire: Wire) -> None:
    answers = Answers(needed=False)
    answers.begin(b'a')
    answers.publish(wire, b'1')
    answers.begin(b'b')
    assert not answers.again()
    answers.begin(b'b')
    assert answers.again()
    assert wire.sent == [b'1', b'1']


@pytest.mark.parametrize(('needed', 'known'), [(True, False), (False, True)])
def test_withdrawn_answers_are_not_republished(wire: Wire, needed: bool, known: bool) -> None:
    answers = Answers(needed=needed)
    answers.begin(b'a')
    answers.publish(wire, b'1')
    assert answers.are_kept
    answers.withdraw()
    assert not answers.are_kept
    answers.begin(b'a')
    assert answers.again() == known
    assert wire.sent == [b'1']
