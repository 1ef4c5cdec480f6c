"""Who publishes what: two sources where there must be one, and publishers that are not heard.

In come a node and a topic; out go names, and texts that say who is there and what to do.
"""

import lazy_loader

# What is named as its module is imported from there.
__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'emulated_source': ['SilencePatience', 'is_emulated'],
        'publisher_check': ['PublisherCheck'],
        'publisher_watch': ['PublisherWatch'],
        'rival_watch': ['RivalWatch'],
        'sole_publisher': ['SolePublisher', 'several_publishers'],
    },
)
