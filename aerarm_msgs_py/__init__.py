"""The ROS side in Python: topics and their quality of service, codecs, live topics, bags.

The package converts serialized messages of topics and bags to arrays, and back. `topics.py` lists
the suite's topics. Each of the packages `codecs`, `live_topics`, `storage` and `bags` imports only
from earlier ones in this order.
"""
