"""A payload weighed with the arm's model given: one bag and an estimate in, payload.yaml out."""

from __future__ import annotations

import time
from pathlib import Path

from aerarm_ros.identification.conditioning.conditioning_options import ConditioningOptions
from aerarm_ros.identification.files.estimate_file import payload_yaml
from aerarm_ros.identification.files.estimate_reader import read_estimate, read_gravity
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.identification.payload.identify_payload import weigh_payload
from aerarm_ros.identification.recording.identification_error import IdentificationError
from aerarm_ros.ros.programs.identifier_run import IdentifierRun, tell, tell_replaced

_FILES = ('payload.yaml', MARKER)


class PayloadRun(IdentifierRun):
    """What the command line asks for if it gives a model of the arm."""

    def execute(self) -> str:
        """Identify the payload, write it, and return what is to be printed.

        Raises
        ------
        IdentificationError, BagError, ConfigError
            If a bag or the model can't be used, or the result can't be written.
        """
        options = self._options
        if options.bag or options.validation or not options.payload:
            raise IdentificationError(
                '--model fixes the arm: give the bags with the payload as --payload, and no --bag'
            )
        if options.verify:
            raise IdentificationError('--verify judges an identified arm: give it without --model')
        default = Path('output') / time.strftime('payload_%Y%m%d_%H%M%S', options.started)
        with ResultDirectory(options.out or default, files=_FILES) as directory:
            robot = self._arm.robot
            estimate = read_estimate(options.model, robot)
            if options.gravity is None:
                robot = robot.with_gravity(read_gravity(options.model, robot))
            recordings = [self._recording(path) for path in options.payload]
            conditioning = ConditioningOptions(
                fundamental=options.fundamental,
                harmonics=options.harmonics,
                cutoff=options.cutoff,
                filter=options.filter,
            )
            payload = weigh_payload(robot, estimate, recordings, conditioning)
            directory.write('payload.yaml', payload_yaml(estimate, payload))
            summary = {
                'model': str(options.model),
                'payload': {'mass': payload.mass, 'mass_standard_deviation': float(payload.std[0])},
            }
            directory.write_json(MARKER, summary)
            tell(self._arm.messages)
        tell_replaced(directory)
        return (
            f'Payload: {payload.mass:.4g} ± {payload.std[0]:.2g} kg\n'
            f'{directory.target / "payload.yaml"}'
        )
