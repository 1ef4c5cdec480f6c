"""What the nodes are made of: everything that ROS needs, and nothing that computes.

In come topics, services, parameters and signals; out go calls of the pure rooms, and what these
return as messages. The rooms, in the order of their imports:

- parameters: what a user can set
- process: an executable's command line, start, signals and end
- executors: who runs callbacks beside a loop
- graph: who publishes what
- diagnostics: what people are told
- states: joint states and IMU samples as they come
- bridge: the boards' cycle as a node
- emulation: the same on emulated boards, in a time of its own
- requests: what one node asks of another
- controllers: nodes that answer every state
- playback: planned motions
- recording: from topics to a bag
- page: the arm in a browser
- programs: runs of the identifier, the designer and the demo
- library: what `import aerarm_ros` offers to a program or a notebook

Beside `aerarm_ros.nodes` only this room imports rclpy.
"""
