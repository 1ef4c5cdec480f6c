"""Topic definitions of the suite, codecs and receivers of messages, and access to bags.

The package converts serialized messages of topics and bags to arrays, and back. `topics.py` defines
the topics of the suite and their quality of service. Each of the parts `codecs`, `live_topics`,
`storage` and `bags` imports only from parts that are named before it.
"""
