import pytest

from aerarm_ros.hardware.gate.command_intake import CommandPublishers

FIRST, SECOND, NEW = b'first', b'second', b'new'


def test_a_new_publisher_is_noticed():
    publishers = CommandPublishers()
    assert not publishers.knows(FIRST)
    publishers.look({FIRST: '/a'})
    assert publishers.knows(FIRST)
    assert not publishers.knows(SECOND)


@pytest.mark.parametrize('allowed', ['controller', '/arm/controller', 'arm/controller'])
def test_an_allowed_node_may_command_once_it_was_found(allowed):
    publishers = CommandPublishers([allowed])
    assert not publishers.may_command(FIRST)
    publishers.look({FIRST: '/arm/controller'})
    assert publishers.may_command(FIRST)
    assert publishers.warning == ''


def test_the_list_applies_to_the_sending_node_only():
    publishers = CommandPublishers(['controller'])
    publishers.look({SECOND: '/intruder', FIRST: '/controller'})
    assert publishers.may_command(FIRST)
    assert not publishers.may_command(SECOND)
    assert not publishers.may_command(NEW)
    assert '/intruder publishes joint_command but is not' in publishers.warning


def test_two_publishers_of_one_node_are_two():
    publishers = CommandPublishers(['controller'])
    publishers.look({FIRST: '/controller', SECOND: '/controller'})
    assert publishers.may_command(FIRST)
    assert publishers.may_command(SECOND)
    assert publishers.names == ('/controller', '/controller')


def test_more_than_one_publisher_is_a_warning():
    publishers = CommandPublishers()
    publishers.look({FIRST: '/b', SECOND: '/a'})
    assert publishers.names == ('/a', '/b')
    assert publishers.warning == (
        'joint_command has 2 publishers (/a, /b), so the bridge follows the first sender: '
        'stop all but '
        'one'
    )


def test_before_anybody_looked_there_is_no_publisher():
    assert CommandPublishers().names == ()
    assert CommandPublishers().warning == ''


def test_an_empty_name_on_the_list_allows_no_publisher():
    publishers = CommandPublishers([''])
    assert not publishers.may_command(FIRST)
    publishers.look({FIRST: '/a'})
    assert not publishers.may_command(FIRST)
