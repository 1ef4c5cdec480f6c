"""A first configuration of a new arm, from its URDF.

In comes a robot; out go its drive train and what an excitation may do, as YAML with a mark at every
value that no URDF knows, and a sentence on how to find it.
"""
