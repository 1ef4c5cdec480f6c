"""What an autopilot takes of the arm: accelerations beside its set points, in its own frames.

In come what the arm does to its drone, and the drone's attitude; out goes the acceleration of a set
point, or the sticks of a Betaflight. PX4's loops, as they are public, are there to try it on.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'betaflight_flight': ['BetaflightFlight'],
        'betaflight_link': ['BetaflightLink', 'Firmware'],
        'betaflight_packets': ['motor_outputs', 'rc_packet', 'state_packet'],
        'betaflight_program': ['BetaflightProgram', 'find_betaflight'],
        'betaflight_setup': ['BetaflightSetup'],
        'px4_flight': ['Px4Flight'],
        'px4_frames': ['frd_rotation', 'heading', 'ned'],
        'px4_gains': ['Px4Gains'],
        'px4_loops': ['Px4Loops', 'Px4SetPoint', 'Px4State'],
        'set_point_acceleration': ['SetPointAcceleration'],
    },
)
