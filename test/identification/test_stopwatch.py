"""Stages are timed by name."""

import pytest

from aerarm_ros.identification.identify import Stopwatch


def test_stages_add_up_in_order_even_after_errors() -> None:
    watch = Stopwatch()
    with watch.stage('b'):
        pass
    with pytest.raises(ValueError, match='x'), watch.stage('a'):
        raise ValueError('x')
    before = watch.seconds['b']
    with watch.stage('b'):
        pass
    assert list(watch.seconds) == ['b', 'a']
    assert watch.seconds['b'] >= before
