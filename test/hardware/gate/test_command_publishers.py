import pytest

from aerarm_ros.hardware.gate.command_intake import CommandPublishers

FIRST, SECOND, NEW = b'first', b'second', b'new'
NAMED = {FIRST: '/arm/controller'}
BOTH = {SECOND: '/intruder', FIRST: '/controller'}
ONE = {FIRST: '/a'}


def looked(nodes, allowed=()):
    publishers = CommandPublishers(allowed)
    publishers.look(nodes)
    return publishers


def test_a_message_is_from_the_publisher_that_its_info_names():
    publishers = CommandPublishers()
    assert (publishers.names, publishers.warning) == ((), '')
    for gid in (FIRST, SECOND):
        assert publishers.judge(gid, 2) == (gid, True)
        assert not publishers.knows(gid)
    publishers.look(ONE)  # a new one is noticed
    assert [publishers.knows(gid) for gid in (FIRST, SECOND, None)] == [True, False, True]


@pytest.mark.parametrize(
    ('allowed', 'nodes', 'gid', 'is_allowed'),
    [
        *(
            (name, NAMED, FIRST, True)
            for name in ('controller', '/arm/controller', 'arm/controller')
        ),
        ('controller', {}, FIRST, False),  # until it was found
        ('controller', BOTH, FIRST, True),
        ('controller', BOTH, SECOND, False),
        ('controller', BOTH, NEW, False),
        ('', {}, FIRST, False),  # an empty name allows nobody
        ('', ONE, FIRST, False),
        # Where no message names its publisher, the list judges all of them.
        ('a', {}, None, False),
        ('a', ONE, None, True),
        ('a', {FIRST: '/intruder'}, None, False),
    ],
)
def test_the_list_applies_to_the_sending_node(allowed, nodes, gid, is_allowed):
    source, answer = looked(nodes, [allowed]).judge(gid, max(1, len(nodes)))
    assert answer is is_allowed
    assert gid is None or source == gid


def test_forbidden_and_duplicate_publishers_are_warnings():
    assert '/intruder publishes joint_command but is not' in looked(BOTH, ['controller']).warning
    assert looked(NAMED, ['controller']).warning == ''
    twice = looked({FIRST: '/controller', SECOND: '/controller'}, ['controller'])
    assert [twice.judge(gid, 2) for gid in (FIRST, SECOND)] == [(FIRST, True), (SECOND, True)]
    assert twice.names == ('/controller', '/controller')
    publishers = looked({FIRST: '/b', SECOND: '/a'})
    assert publishers.names == ('/a', '/b')
    followed = 'joint_command has 2 publishers (/a, /b), so the bridge follows the first sender: '
    for gid, warning in (
        (FIRST, f'{followed}stop all but one'),
        (
            None,
            'joint_command has 2 publishers (/a, /b), and this ROS version does not report the '
            'sender of a message: stop all but one',
        ),
    ):
        assert followed in publishers.warning or gid is None  # before the first message
        publishers.judge(gid, 2)
        assert publishers.warning == warning


def test_where_no_message_names_its_publisher_one_publisher_commands_and_two_are_rejected():
    publishers = CommandPublishers()
    source, allowed = publishers.judge(None, 1)
    assert source is not None
    assert allowed
    publishers.look(ONE)
    assert publishers.judge(None, 1) == (source, True)
    assert publishers.judge(None, 2) == (None, True)  # the look comes later
    publishers.look({**ONE, SECOND: '/b'})
    assert publishers.judge(None, 1) == (None, True)  # the match comes later
