"""The ROS side in Python: topics, QoS, message codecs, bag writing and reading."""
