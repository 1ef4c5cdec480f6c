"""Text and hash of message types, which make a bag readable without ROS."""

from dataclasses import dataclass
from functools import lru_cache


@dataclass(frozen=True)
class MessageDefinition:
    """Definition of one message type.

    Attributes
    ----------
    text
        The .msg text with that of all types inside it; '' if the type isn't known.
    hash
        Type hash (REP 2016), '' if the type isn't known.
    """

    text: str
    hash: str


@lru_cache
def message_definition(message_type: str) -> MessageDefinition:
    """Look up a type of the ROS 2 Jazzy distribution, for example 'std_msgs/msg/String'."""
    # Imported here because it takes 0.1 s and readers don't need it.
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    if message_type not in store.fielddefs:
        return MessageDefinition('', '')
    text, _ = store.generate_msgdef(message_type, ros_version=2)
    return MessageDefinition(text, store.hash_rihs01(message_type))
