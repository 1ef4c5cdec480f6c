"""What the node that flies a drone is made of.

In come parameters and messages with places, ways and what the arm does; out go the pure objects of
`aerarm_ros.flight`, and what is wrong with a message.
"""
