"""The way to the boards: a frame there, a frame back.

In come the bytes of a frame for one board; out go those of its answer. `Transport` is what a way
must be able to do, `SpidevTransport` the SPI buses of Linux; the emulated one lies in `emulation`.
"""
