"""Playback of a planned motion on the arm.

The playback waits for bridge, subscribers and recorder, publishes the commands of an
`ExcitationPlayer`, and collects the measurements of the motor bench.
"""
