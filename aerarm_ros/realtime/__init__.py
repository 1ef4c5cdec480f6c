"""Real-time execution: periodic loops, and real-time settings of the operating system.

A loop calls a function on a grid of deadlines, or in simulation time, and collects statistics of
the timing.
"""
