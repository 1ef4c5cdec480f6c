"""Boards that are not there, on an arm that is simulated.

In come the bridge's frames; out go the frames that real boards would answer with, whose motors
turn the arm of a physics engine. `make_emulated_transport` builds them; faults can be injected.
"""
