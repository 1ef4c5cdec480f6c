"""Motions from rest to rest that cost little, within every limit.

In come an arm's model with friction and payload, its limits, and where it is to go: joints or a
place of the tool; out go a motion, what it will take, and its margins in a dense check.
"""
