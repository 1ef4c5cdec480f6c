"""Fixtures of the ROS rooms' tests."""

from bridge_fixtures import bridge, client, start_bridge

__all__ = ['bridge', 'client', 'start_bridge']
