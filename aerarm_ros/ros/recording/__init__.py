"""From topics to a bag.

In come names of topics and their serialized messages; out goes a bag, without what was told twice,
and an account of what is missing in it.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'bag_feed': ['BagFeed'],
        'loss_watch': ['LossWatch'],
        'recorded_topics': ['SUITE_TOPICS', 'as_recorded', 'find_topics', 'for_recording'],
        'repeated_states': ['RepeatedStates'],
    },
)
