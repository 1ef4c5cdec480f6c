"""A planned motion, played on the arm.

In comes an `ExcitationPlayer`; out go its commands, once bridge, listeners and recorder are
there, and what a motor bench measures meanwhile.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'bench_recording': ['BenchRecording'],
        'damping_account': ['DampingAccount'],
        'motion_playback': ['MotionPlayback'],
        'motor_readings': ['MotorReadings'],
        'start_conditions': ['StartConditions'],
    },
)
