"""Playback of planned motions, for `excitation` and `motor_bench`.

The playback waits for bridge, subscribers and recorder, publishes the commands of an
`ExcitationPlayer`, and collects the measurements of the motor bench.
"""
