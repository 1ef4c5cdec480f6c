"""The arm's states as they come: every one for a loop, or the newest for people.

In come serialized messages of joint_states, imu and rotor_command; out go positions, velocities
and torques in the arm's order of joints, what there is to say of the stream on /diagnostics, and
what others make of states: headers, and which modes hold the arm.
"""

import lazy_loader

# What is named as its module is imported from there.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'arm_clock': ['ArmClock', 'monotonic_ns'],
        'arm_modes': ['COMMANDABLE', 'HELD', 'OFF', 'to_switch_on'],
        'rotor_thrusts': ['RotorThrusts'],
        'state_diagnostics': ['StateDiagnostics'],
        'state_sampler': ['StateSampler'],
        'state_stream': ['StateStream', 'to_imu_sample'],
    },
)
