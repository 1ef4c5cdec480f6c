"""Parts of the nodes that need ROS; equations are in the other packages.

These modules turn topics, services, parameters and signals into calls of the ROS-free packages,
and publish the results. The packages, in the order of their imports:

- parameters: settings of the user
- process: an executable's command line, start, signals and end
- executors: threads for callbacks next to a loop
- graph: publishers and subscribers of topics
- diagnostics: messages for people
- states: joint states and IMU samples
- bridge: the node around the cycle of the boards
- emulation: the bridge on emulated boards, in simulation time
- requests: requests from one node to another
- controllers: nodes that answer every state
- playback: planned motions
- recording: from topics to a bag
- page: the arm in a browser
- programs: runs of the identifier, the designer and the demo
- library: the functions of `import aerarm_ros` for programs and notebooks

Only this package and `aerarm_ros.nodes` import rclpy.
"""
