"""Real time: periodic loops with deadlines, and requests to the operating system.

A loop calls a function on a grid of deadlines, or in simulation time, and collects statistics of
the timing.
"""
