"""Plays a planned motion: every measured state is answered by one command.

In come states with their stamps; out goes the `JointCommand` of the chosen command law, and a
stop on the path when the arm does not follow.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'command_law': ['CommandLaw'],
        'excitation_player': ['PlayState', 'ExcitationPlayer'],
        'feed_forward_law': ['FeedForwardLaw'],
        'velocity_law': ['VelocityLaw'],
    },
)
