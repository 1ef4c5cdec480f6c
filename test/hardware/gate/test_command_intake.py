import math
from itertools import permutations

import numpy as np
import pytest

from aerarm_ros.hardware.gate.bridge_settings import BridgeSettings
from aerarm_ros.hardware.gate.command_intake import (
    _ORDERS_KEPT,
    REJECTIONS,
    CommandIntake,
    OfferedCommand,
)

NAMES = ('a', 'b', 'c')
ONE = [0.1, 0.2, 0.3]
NAN = math.nan


@pytest.fixture
def intake():
    return CommandIntake(NAMES, BridgeSettings())


def offer(intake, position=None, velocity=ONE, effort=None, now=5.0, ready=True, **options):
    given = {'names': NAMES, 'age_of_stamp': 0.001, 'source': 'me', **options}
    offered = OfferedCommand(position=position, velocity=velocity, effort=effort, **given)
    return intake.offer(offered, now, ready=ready)


def test_a_good_command_is_kept(intake):
    assert offer(intake, position=[1, 2, 3], velocity=np.array([4.0, 5.0, 6.0]), effort=())
    assert intake.command.q.tolist() == [1.0, 2.0, 3.0]
    assert intake.command.dq.tolist() == [4.0, 5.0, 6.0]
    assert np.isnan(intake.command.tau).all()
    assert intake.accepted == 1
    assert not intake.rejections
    assert offer(intake)
    assert intake.accepted == 2


def test_before_the_first_command_there_is_no_command_and_no_rejection(intake):
    assert intake.age(5.0) == math.inf
    assert not intake.is_fresh(5.0)
    assert (intake.last_rejection, intake.last_rejection_time) == ('', -math.inf)
    command = OfferedCommand(NAMES, None, ONE, None, 0.0, 'me')
    assert intake.offer(command, 5.0)  # an arm is ready unless it is said not to be
    intake.forget()
    assert intake.age(5.0) == math.inf


def test_order_goes_by_name(intake):
    assert offer(intake, names=['c', 'a', 'b'], velocity=[3.0, 1.0, 2.0], effort=[30.0, 10.0, 20.0])
    assert intake.command.dq.tolist() == [1.0, 2.0, 3.0]
    assert intake.command.tau.tolist() == [10.0, 20.0, 30.0]
    assert offer(intake, velocity=[1.0, 2.0, 3.0])
    assert intake.command.dq.tolist() == [1.0, 2.0, 3.0]


def test_each_joint_may_use_other_quantities(intake):
    assert offer(intake, position=[1, NAN, NAN], velocity=[NAN, 2, NAN], effort=[NAN, NAN, 3])
    assert intake.command.q[0] == 1.0
    assert np.isnan(intake.command.q[1:]).all()


@pytest.mark.parametrize(
    ('reason', 'wrong'),
    [
        ('not_ready', {'ready': False}),
        ('names', {'names': ('a', 'b', 'x')}),
        ('names', {'names': ('a', 'b')}),
        ('names', {'names': ('a', 'b', 'b')}),
        ('names', {'names': ('a', 'b', 'c', 'd'), 'velocity': [1, 2, 3, 4]}),
        ('names', {'names': ()}),
        ('length', {'velocity': [1.0, 2.0]}),
        ('length', {'velocity': [1.0, 2.0, 3.0, 4.0]}),
        ('length', {'effort': [1.0]}),
        ('nan', {'velocity': [1.0, NAN, 3.0]}),
        ('nan', {'velocity': None}),
        ('nan', {'position': [NAN, NAN, NAN], 'velocity': []}),
        ('infinite', {'velocity': [1.0, math.inf, 3.0]}),
        ('infinite', {'effort': [1.0, 2.0, -math.inf]}),
        ('stale', {'age_of_stamp': 0.051}),
        ('stale', {'age_of_stamp': NAN}),
        ('future', {'age_of_stamp': -0.5}),
    ],
)
def test_each_reason_is_counted_and_the_command_before_stays(intake, reason, wrong):
    assert offer(intake, velocity=[7.0, 8.0, 9.0])
    assert not offer(intake, now=5.01, **wrong)
    assert intake.rejections == {reason: 1}
    assert intake.last_rejection == reason
    assert REJECTIONS[reason]
    assert intake.last_rejection_time == 5.01
    assert intake.command.dq.tolist() == [7.0, 8.0, 9.0]
    assert intake.age(5.01) == pytest.approx(0.01)


def test_commands_exactly_at_the_age_limits_are_accepted_and_followed(intake):
    assert offer(intake, age_of_stamp=0.05, now=0.0)
    assert not intake.is_fresh(-0.001)
    assert intake.is_fresh(0.0)
    assert intake.is_fresh(0.05)
    assert not intake.is_fresh(0.051)
    assert offer(intake, age_of_stamp=-0.005, now=0.1)


def test_a_second_publisher_waits_until_the_first_is_silent(intake):
    assert offer(intake, source='first', now=5.0)
    assert not offer(intake, source='second', now=5.02)
    assert intake.rejections == {'source': 1}
    assert offer(intake, source='first', now=5.04)
    assert not offer(intake, source='second', now=5.08)
    assert offer(intake, source='second', now=5.10)
    assert not offer(intake, source='first', now=5.11)
    intake.forget()
    assert offer(intake, source='first', now=5.12)


def test_commands_shortly_after_the_last_one_do_not_revoke_an_intended_end(intake):
    for late, is_concluded in ((0.05, True), (0.051, False)):
        intake.conclude(5.0)
        assert offer(intake, now=5.0 + late)
        assert intake.is_concluded == is_concluded


def test_a_rejected_command_gives_no_claim(intake):
    assert not offer(intake, velocity=None, source='broken')
    assert offer(intake, source='good')


def test_publishers_that_are_not_allowed_or_unidentified_are_rejected(intake):
    assert not offer(intake, allowed=False)
    assert not offer(intake, source=None)
    assert not offer(intake, source=None)
    assert intake.rejections == {'not_allowed': 1, 'source': 2}
    assert all(REJECTIONS[reason] for reason in ('not_allowed', 'source', 'unreadable'))
    assert offer(intake)


def test_boards_without_feed_forward_take_no_effort():
    intake = CommandIntake(NAMES, BridgeSettings(), effort_supported=False)
    assert not offer(intake, effort=ONE)
    assert intake.rejections == {'unsupported': 1}
    assert REJECTIONS['unsupported']
    assert offer(intake)


def test_orders_without_end_are_read_and_take_no_memory():
    names = ('a', 'b', 'c', 'd', 'e')
    intake = CommandIntake(names, BridgeSettings())
    for number, order in enumerate(permutations(range(5))):
        assert not offer(intake, names=(f'x{number}', *'bcde'))
        given = {'names': tuple(names[k] for k in order), 'velocity': [float(k) for k in order]}
        assert offer(intake, **given)
        assert intake.command.dq.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
        assert len(intake._orders) <= _ORDERS_KEPT
    assert offer(intake, names=names, velocity=[5.0, 6.0, 7.0, 8.0, 9.0])
    assert intake.command.dq.tolist() == [5.0, 6.0, 7.0, 8.0, 9.0]
