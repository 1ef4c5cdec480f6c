"""The ROS side in Python: topics and their quality of service, codecs, live topics, bags.

In come serialized messages, from topics and from bags; out go numbers as arrays, and the other
way round. `topics.py` lists what the suite says and hears; the rooms, each importing only from
those before it: `codecs`, `live_topics`, `storage`, `bags`.
"""
