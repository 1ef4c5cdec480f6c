"""Transports that exchange SPI frames with the motor boards.

A transport sends the bytes of a frame to one board and returns the bytes of its answer. `Transport`
in `boards/board_link.py` is the interface, and `SpidevTransport` uses the SPI buses of Linux. The
emulated transport is in the package `emulation`.
"""
