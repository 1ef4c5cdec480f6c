"""The ROS side in Python: topics and their quality of service, codecs, live topics, bags.

In come serialized messages, from topics and from bags; out go numbers as arrays, and the other
way round. `topics.py` lists what the suite says and hears; the rooms, each importing only from
those before it: `codecs`, `live_topics`, `storage`, `bags`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submodules=['topics', 'codecs', 'live_topics', 'storage', 'bags'],
    submod_attrs={
        'codecs.float64_array_cdr': ['Float64ArrayCdr'],
        'codecs.joint_sample': ['JointSample'],
        'codecs.joint_state_cdr': ['JointStateCdr'],
        'live_topics.raw_reader': ['RawReader'],
        'live_topics.topic': ['Topic'],
        'storage.bag_error': ['BagError', 'BagWarning'],
        'storage.read_limits': ['ReadLimits'],
        'bags.bag_contents': ['BagContents', 'read_contents'],
        'bags.bag_reader': ['read_joint_states'],
        'bags.bag_writer': ['BagWriter'],
        'bags.joint_state_series': ['JointStateSeries'],
        'bags.recorded_message': ['RecordedMessage'],
        'bags.recorded_topic': ['RecordedTopic'],
    },
)
