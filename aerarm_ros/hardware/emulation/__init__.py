"""Boards that are not there, on an arm that is simulated.

In come the bridge's frames; out go the frames that real boards would answer with, whose motors
turn the arm of a physics engine. `make_emulated_transport` builds them; faults can be injected.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'alignment_timing': ['AlignmentTiming'],
        'answer_watch': ['AnswerWatch'],
        'board_faults': ['BoardFaults'],
        'board_wiring': ['BoardWiring'],
        'emulated_base': ['mount_on_base', 'mount_on_drone'],
        'emulated_board': ['EmulatedBoard'],
        'emulated_encoder': ['EmulatedEncoder'],
        'emulated_hand': ['EmulatedHand', 'parse_turn'],
        'emulated_motor': ['EmulatedMotor'],
        'emulated_transport': ['EmulatedTransport'],
        'emulation': ['make_emulated_transport'],
        'fault_injection': ['FAULTS', 'Fault', 'FaultInjectionError', 'check', 'inject'],
        'fault_request': ['FaultRequest'],
    },
)
