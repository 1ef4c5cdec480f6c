import pytest

from aerarm_ros.hardware.gate.command_intake import CommandPublishers

FIRST, SECOND, NEW = b'first', b'second', b'new'


def test_a_message_is_from_the_publisher_that_its_info_names():
    publishers = CommandPublishers()
    assert publishers.judge(FIRST, 2) == (FIRST, True)
    assert publishers.judge(SECOND, 2) == (SECOND, True)


def test_a_new_publisher_is_noticed():
    publishers = CommandPublishers()
    assert not publishers.knows(FIRST)
    publishers.look({FIRST: '/a'})
    assert publishers.knows(FIRST)
    assert not publishers.knows(SECOND)
    assert publishers.knows(None)


@pytest.mark.parametrize('allowed', ['controller', '/arm/controller', 'arm/controller'])
def test_an_allowed_node_may_command_once_it_was_found(allowed):
    publishers = CommandPublishers([allowed])
    assert publishers.judge(FIRST, 1) == (FIRST, False)
    publishers.look({FIRST: '/arm/controller'})
    assert publishers.judge(FIRST, 1) == (FIRST, True)
    assert publishers.warning == ''


def test_the_list_applies_to_the_sending_node_only():
    publishers = CommandPublishers(['controller'])
    publishers.look({SECOND: '/intruder', FIRST: '/controller'})
    assert publishers.judge(FIRST, 2) == (FIRST, True)
    assert publishers.judge(SECOND, 2) == (SECOND, False)
    assert publishers.judge(NEW, 2) == (NEW, False)
    assert '/intruder publishes joint_command but is not' in publishers.warning


def test_two_publishers_of_one_node_are_two():
    publishers = CommandPublishers(['controller'])
    publishers.look({FIRST: '/controller', SECOND: '/controller'})
    assert publishers.judge(FIRST, 2) == (FIRST, True)
    assert publishers.judge(SECOND, 2) == (SECOND, True)
    assert publishers.names == ('/controller', '/controller')


def test_more_than_one_publisher_is_a_warning():
    publishers = CommandPublishers()
    publishers.look({FIRST: '/b', SECOND: '/a'})
    assert publishers.names == ('/a', '/b')
    publishers.judge(FIRST, 2)
    assert publishers.warning == (
        'joint_command has 2 publishers (/a, /b), so the bridge follows the first sender: '
        'stop all but '
        'one'
    )


def test_where_no_message_names_its_publisher_one_publisher_commands():
    publishers = CommandPublishers()
    source, allowed = publishers.judge(None, 1)
    assert source is not None
    assert allowed
    publishers.look({FIRST: '/a'})
    assert publishers.judge(None, 1) == (source, True)


def test_where_no_message_names_its_publisher_two_publishers_are_rejected_and_named():
    publishers = CommandPublishers()
    publishers.look({FIRST: '/a'})
    assert publishers.judge(None, 2) == (None, True)  # the look comes later
    publishers.look({FIRST: '/a', SECOND: '/b'})
    assert publishers.judge(None, 1) == (None, True)  # the match comes later
    assert publishers.warning == (
        'joint_command has 2 publishers (/a, /b), and this ROS version does not report the '
        'sender of a message: stop all but one'
    )


def test_where_no_message_names_its_publisher_the_list_judges_all_of_them():
    publishers = CommandPublishers(['a'])
    assert publishers.judge(None, 1)[1] is False
    publishers.look({FIRST: '/a'})
    assert publishers.judge(None, 1)[1] is True
    publishers.look({FIRST: '/intruder'})
    assert publishers.judge(None, 1)[1] is False


def test_before_anybody_looked_there_is_no_publisher():
    assert CommandPublishers().names == ()
    assert CommandPublishers().warning == ''


def test_an_empty_name_on_the_list_allows_no_publisher():
    publishers = CommandPublishers([''])
    assert publishers.judge(FIRST, 1) == (FIRST, False)
    publishers.look({FIRST: '/a'})
    assert publishers.judge(FIRST, 1) == (FIRST, False)
