"""The arm's states as they come: every one for a loop, or the newest for people.

In come serialized messages of joint_states and imu; out go positions, velocities and torques in
the arm's order of joints, and what there is to say of the stream on /diagnostics.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'state_diagnostics': ['StateDiagnostics'],
        'state_sampler': ['StateSampler'],
        'state_stream': ['StateStream', 'to_imu_sample'],
    },
)
