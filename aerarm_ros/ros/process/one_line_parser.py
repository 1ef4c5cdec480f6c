"""A command line whose faults are told in one line."""

import argparse
from typing import NoReturn

from aerarm_ros.ros.process.exit_status import USER_ERROR


class OneLineParser(argparse.ArgumentParser):
    """Names a wrong argument and the way to the help, in place of the whole usage."""

    def error(self, message: str) -> NoReturn:
        """End the process."""
        self.exit(USER_ERROR, f'{self.prog}: {message}: see {self.prog} --help\n')
