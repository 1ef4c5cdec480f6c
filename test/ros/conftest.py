"""Fixtures of the tests of aerarm_ros/ros."""

from bridge_fixtures import bridge, client, start_bridge

__all__ = ['bridge', 'client', 'start_bridge']
