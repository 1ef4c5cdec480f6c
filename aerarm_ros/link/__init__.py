"""The connection between drone and ground, without ROS: encrypted datagrams, messages, windows.

In come bytes of topics and services, with the time; out go datagrams of a bounded rate.
"""
