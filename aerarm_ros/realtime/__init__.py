"""Time: loops with deadlines, and what they ask of the operating system.

In comes a function to call; out go calls on a grid of deadlines, or at the pace of an emulated
world, and statistics of how well that went.
"""
