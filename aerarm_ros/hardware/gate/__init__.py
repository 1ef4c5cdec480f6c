"""What stands between a command and the motors.

In comes what somebody offers, before anything about it is believed; out goes a command within the
limits of position, velocity, effort and its rate, or the reason why the arm is stopped.
"""
