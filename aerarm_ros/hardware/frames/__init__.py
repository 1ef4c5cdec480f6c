"""The wire: what stands where in a frame of 34 bytes.

In comes a profile (a YAML file) and a command for a board; out goes a frame. In comes a frame; out
goes what the board reports, or None where its check sum is wrong.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'board_command': ['BoardCommand'],
        'board_state': ['BoardState'],
        'crc': ['crc32_mpeg2'],
        'frame_codec': ['FrameCodec', 'FrameError'],
        'frame_field': ['FrameField', 'ProfileError'],
        'frame_profile': ['FrameLayout', 'FrameProfile', 'load_profile'],
    },
)
