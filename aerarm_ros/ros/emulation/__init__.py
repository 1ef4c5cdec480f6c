"""The bridge on emulated boards, and the world in which they are: its time, its drone.

In comes what a bridge has, how fast time shall pass, and what a drone's rotors shall do; out goes
`FakeHardware`, a bridge whose arm nobody can hurt. The emulated boards themselves are in
`hardware.emulation`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'drone_parameters': ['DRONE_PARAMETERS'],
        'emulated_drone': ['EmulatedDrone'],
        'emulated_world': ['EmulatedWorld', 'PACE_PARAMETERS'],
        'emulation_parameters': ['EMULATION_PARAMETERS'],
        'fake_hardware': ['FakeHardware'],
        'flying_drone': ['FlyingDrone'],
        'recording_watch': ['RecordingWatch'],
        'world_clock': ['WorldClock'],
    },
)
