"""Emulated arm and drone of the node `fake_hardware`, and their simulation time.

`EmulatedArm` replaces the boards and the clock of a bridge by emulated boards (package
`hardware.emulation`), a physics simulation and its time. A drone in the simulation receives rotor
commands.
"""
