"""Bags: rosbag2 folders of MCAP files, written so that they survive, read whatever their storage.

In come serialized messages and what is said of their topics; out goes a bag. And back: blocks of
messages, joint states as arrays, what else a motion left behind. Reading needs no ROS.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'bag': ['Bag'],
        'bag_contents': ['BagContents', 'lost_messages', 'read_contents'],
        'bag_information': ['BagInformation', 'read_information'],
        'bag_reader': ['joint_state_blocks', 'read_joint_states'],
        'bag_writer': ['BagWriter'],
        'joint_state_series': ['JointStateSeries'],
        'mcap_writer': ['COMPRESSIONS', 'McapWriter'],
        'recorded_message': ['RecordedMessage'],
        'recorded_topic': ['RecordedTopic'],
        'topic_summary': ['TopicSummary'],
    },
)
