"""What a user need not choose: filter, where gravity points, and which friction each joint has.

In come recordings or samples; out go the filter with the least torque error and the terms that
predict held-out motion best, each with what else was tried.
"""
