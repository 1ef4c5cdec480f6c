"""Serialized messages (CDR) to numbers and back.

In come the bytes of one message, or of many in one buffer; out go stamps and arrays. Messages of
a layout that is known are read and packed at fixed offsets, others field by field.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'cdr_reader': ['CdrReader'],
        'diagnostics_cdr': ['diagnostic_values'],
        'float64_array_cdr': ['Float64ArrayCdr'],
        'joint_sample': ['JointSample'],
        'joint_state_cdr': ['JointStateCdr'],
        'joint_state_conversion': [
            'decode_as_sent',
            'decode_joint_state',
            'from_message',
            'in_order',
            'to_message',
        ],
        'joint_state_decoder': ['JointStateDecoder'],
        'joint_state_layout': ['JointStateLayout'],
        'payloads': ['Payloads'],
        'ros1_messages': ['Ros1Messages'],
    },
)
