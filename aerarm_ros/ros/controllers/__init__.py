"""What controllers are made of: a loop that answers every state, and where references come in.

In come parameters, joint states, IMU samples and messages with references; out go pure objects of
`control`, fed in one thread, and their commands. A controller derives from `ControllerNode`.
"""
