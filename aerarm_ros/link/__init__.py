"""Connection between drone and ground, without ROS: encrypted datagrams, messages, windows.

Bytes of topics and services become datagrams with a limited rate.
"""
