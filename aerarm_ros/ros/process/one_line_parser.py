"""A command line whose faults are told in one line."""

import argparse
from typing import Any, NoReturn

from aerarm_ros.ros.process import completion
from aerarm_ros.ros.process.exit_status import USER_ERROR


class OneLineParser(argparse.ArgumentParser):
    """Names a wrong argument and the way to the help, in place of the whole usage.

    Asked for with `completion.OPTION`, it prints what makes a shell complete all this.
    """

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.add_argument(completion.OPTION, action=_Completion, help=argparse.SUPPRESS)

    def error(self, message: str) -> NoReturn:
        """End the process."""
        self.exit(USER_ERROR, f'{self.prog}: {message}: see {self.prog} --help\n')


class _Completion(argparse.Action):
    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **{**kwargs, 'nargs': 0, 'default': argparse.SUPPRESS})

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(completion.parser_script(parser))
        parser.exit()
