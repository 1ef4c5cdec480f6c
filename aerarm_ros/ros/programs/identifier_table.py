"""The identifier's result as text for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping

from aerarm_ros.identification.assessment.identification_result import IdentificationResult
from aerarm_ros.identification.recording.bag_facts import BagFacts

_ROLES = ('identification', 'validation')


def terminal_table(result: IdentificationResult, facts: Mapping[str, BagFacts]) -> str:
    """Return the errors of each solver on each bag, and what was used of the bags.

    Parameters
    ----------
    result : IdentificationResult
    facts : mapping
        Name of a bag to what is known of it.
    """
    groups = zip(_ROLES, (result.identification, result.validation), strict=True)
    bags = [(role, bag.samples.name) for role, columns in groups for bag in columns]
    width = max(22, *(len(text) for heading in bags for text in heading)) + 2
    lines = ['Torque error [%], filtered / only the measured one filtered (raw)']
    for row in zip(*bags, strict=True):
        lines.append(' ' * 10 + ''.join(text.rjust(width) for text in row))
    for name, solution in result.solutions.items():
        cells = [
            f'{bag.filtered:.2f} / {bag.filtered_measured:.2f} ({bag.raw:.2f})'.rjust(width)
            for bag in (*solution.identification, *solution.validation)
        ]
        consistent = '' if solution.estimate.physically_consistent else '  not a physical arm'
        lines.append(name.ljust(10) + ''.join(cells) + consistent)
    if result.gravity is not None and result.gravity.tilt > 0.0:
        degrees = math.degrees(result.gravity.tilt)
        lines.append(f'gravity: {degrees:.2f} degrees off the stated direction, taken as found')
    lines += [f'{bag}: {known.text}' for bag, known in facts.items()]
    return '\n'.join(lines)
