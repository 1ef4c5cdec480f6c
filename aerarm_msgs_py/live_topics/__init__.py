"""Topics as they live: what one is, and its messages as they arrive.

In comes a topic; out go serialized messages, the newest or one by one, and how many were lost on
the way. They come from a wait set, or from the executor of an rclpy that lacks its calls.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'executor_source': ['ExecutorSource'],
        'identified_take': ['IdentifiedTake'],
        'publisher_gaps': ['PublisherGaps'],
        'raw_reader': ['RawReader'],
        'sequence_gaps': ['UNNUMBERED', 'SequenceGaps'],
        'topic': ['Topic'],
        'wait_set_source': ['WaitSetSource'],
    },
)
