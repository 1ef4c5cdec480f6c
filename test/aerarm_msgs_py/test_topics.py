from rclpy.qos import HistoryPolicy, ReliabilityPolicy

from aerarm_msgs_py import topics


def test_publishers_of_the_suite_match_every_subscription() -> None:
    for topic in topics.TOPICS.values():
        assert topic.offered.reliability == ReliabilityPolicy.RELIABLE
        # A slow subscriber would hold up a publisher that keeps all.
        assert topic.offered.history == HistoryPolicy.KEEP_LAST
        assert (topic.offered.depth, topic.offered.durability) == (
            topic.qos.depth,
            topic.qos.durability,
        )


def test_names_are_relative_so_that_a_namespace_moves_the_arm() -> None:
    absolute = [name for name in topics.TOPICS if name.startswith('/')]
    assert absolute == ['/diagnostics', '/clock']
    assert all(topics.TOPICS[name].name == name for name in topics.TOPICS)


def test_no_subscription_is_reliable_and_shallow() -> None:
    # A reliable reader of depth 1 waits for what was lost and drops what comes meanwhile.
    for topic in topics.TOPICS.values():
        is_latched = topic.qos.durability == topics.LATCHED.durability
        is_best_effort = topic.qos.reliability == ReliabilityPolicy.BEST_EFFORT
        assert is_best_effort or is_latched or topic.qos.depth >= 10, topic.name
