"""An executable as a process: its command line, its start, signals, its end, and its children.

In come arguments and what makes a node; out goes an exit status, with one line on standard error
for whatever a user can mend. `NodeProcess` starts another executable and ends it. Some modules
serve programs that have no node, and import no ROS.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(
    __name__,
    submod_attrs={
        'command_line': ['CommandLine'],
        'completion': ['lazy_script', 'node_script', 'parser_script'],
        'discovery_profile': ['use_packaged_profile'],
        'exit_limit': ['ExitLimit', 'exit_within'],
        'exit_status': ['INTERRUPTED', 'USER_ERROR', 'print_error'],
        'local_discovery': ['is_domain_free', 'is_on_this_host', 'stay_on_this_host'],
        'node_main': ['Runnable', 'run_node'],
        'node_process': ['NodeProcess', 'ros_environment'],
        'one_line_parser': ['OneLineParser'],
        'ros_arguments': ['GivenParameter', 'RosArguments', 'UsageError'],
        'stop_signals': ['StopSignals'],
    },
)
