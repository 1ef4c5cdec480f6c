"""Parts of the nodes that need ROS; the equations are in packages without ROS.

These modules connect topics, services, parameters and signals with the packages that do not import
ROS. The packages, in the order of their imports:

- parameters: ROS parameters
- process: command line, start, signals and end of an executable
- executors: callbacks in a thread next to a loop
- graph: publishers and subscribers of topics
- diagnostics: diagnostics of a node
- states: subscriptions to joint states and IMU samples
- bridge: node of the bridge
- emulation: bridge with emulated boards, in simulation time
- requests: clients of the bridge and of other nodes
- controllers: nodes that answer every joint state
- playback: nodes that play a precomputed motion
- recording: recording of topics in a bag
- page: web page of the arm
- programs: runs of the identifier, the designer and the demo
- library: functions of `import aerarm_ros` for programs and notebooks

Only this package and `aerarm_ros.nodes` import rclpy.
"""
