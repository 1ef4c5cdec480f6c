"""Safety gate between joint commands and motors.

The gate validates each received command. It returns a command within the limits of position,
velocity, effort and effort rate, or the reason why the arm is stopped.
"""
