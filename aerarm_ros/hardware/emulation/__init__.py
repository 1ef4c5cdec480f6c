"""Emulated motor boards that exchange SPI frames with the bridge and drive a simulated arm.

The boards receive the bridge's frames and answer with frames like real boards; their motors drive
the arm of a physics engine. `make_emulated_transport` creates them. Faults of boards and encoders
can be injected.
"""
