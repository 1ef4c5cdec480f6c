"""The way to the boards: a frame there, a frame back.

In come the bytes of a frame for one board; out go those of its answer. `Transport` is what a way
must be able to do, `SpidevTransport` the SPI buses of Linux; the emulated one lies in `emulation`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'spidev_device': ['SpidevDevice'],
        'spidev_transport': ['SpidevTransport'],
        'transport': ['Transport', 'TransportError'],
    },
)
