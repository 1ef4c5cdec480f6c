"""What stands between a command and the motors.

In comes what somebody offers, before anything about it is believed; out goes a command within the
limits of position, velocity, effort and its rate, or the reason why the arm is stopped.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'answer': ['Answer'],
        'bridge_settings': ['BridgeSettings'],
        'command_buffer': ['CommandBuffer'],
        'command_intake': ['CommandIntake', 'REJECTIONS'],
        'command_publishers': ['CommandPublishers'],
        'joint_barrier': ['JointBarrier'],
        'joint_limiter': ['JointLimiter'],
        'joint_loads': ['JointLoads'],
        'offered_command': ['OfferedCommand'],
        'safety_gate': ['SafetyGate'],
    },
)
