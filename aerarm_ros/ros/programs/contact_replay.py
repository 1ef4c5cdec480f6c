"""`contact_estimator --bag`: search recordings for contact, and learn contact thresholds."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from aerarm_ros.identification.errors import IdentificationError
from aerarm_ros.identification.files.result_directory import MARKER, ResultDirectory
from aerarm_ros.identification.recording.recording import Recording
from aerarm_ros.motion.signals import Array
from aerarm_ros.online.contact_detector import Cause, ContactDetector, ContactEvent, with_rest_share
from aerarm_ros.online.contact_place import ContactLocator, ContactPlace
from aerarm_ros.online.external_torque import ExternalTorque, ResidualBound, free_rows
from aerarm_ros.online.information_filter import ball
from aerarm_ros.online.replay import recorded_states
from aerarm_ros.pages.html_text import Html, bullets, origin, page, paragraph, section
from aerarm_ros.pages.plots import StackedFigure, plotting_script
from aerarm_ros.ros.controllers.contact_parameters import (
    CONTACT_ESTIMATOR_PARAMETERS,
    GAIN_PARAMETER,
    RESIDUALS,
    RESIDUALS_SECTION,
    contact_settings,
    read_residuals,
)
from aerarm_ros.ros.process.process_end import USER_ERROR, print_error, print_notice
from aerarm_ros.ros.process.ros_arguments import OneLineParser
from aerarm_ros.ros.programs.identifier_options import Option, add_arm_options, table_parser
from aerarm_ros.ros.programs.identifier_run import RecordedArm
from aerarm_ros.ros.programs.payload_replay import (
    add_parameters,
    check_parameters,
    known_arm,
    run_replay,
)

REPORT = 'contacts.html'

_FILES = (RESIDUALS, REPORT, MARKER)
_PARAMETERS = (GAIN_PARAMETER, *CONTACT_ESTIMATOR_PARAMETERS)
_PLOT_POINTS = 3000  # largest number of points per curve
_PAYLOAD_RADIUS = 0.05  # [m] radius of the ball that represents the body of --payload
# A recording ignores the effort limit of a joint if this quantile of its torque exceeds the
# limit by this factor.
_TORQUE_QUANTILE, _LIMIT_FACTOR = 0.99, 1.02
_NUMBER = re.compile(r'(?<=\s)-?\d\S*')  # a number in a message, except in a joint name
_PROBLEM_GAP = 1.0  # [s] shorter gaps do not divide an interval of a problem
_LISTED_INTERVALS = 3  # largest number of intervals in the message of a problem
_COLOUR = {
    Cause.CONTACT: '#d62728',
    Cause.PAYLOAD: '#2ca02c',
    Cause.RELEASED: '#2ca02c',
    Cause.MODEL: '#7f7f7f',
}


def main() -> int:
    """Search recordings for contact, with the options of this process's command line."""
    return contact_replay('contact_estimator', sys.argv[1:])


def contact_replay(name: str, arguments: Sequence[str]) -> int:
    """Search recordings for contact, and return the exit status.

    The exit status is 0 after success, 2 if the user must check an input, and 130 after a stop.
    If one bag cannot be searched, the program prints the reason, searches the other bags, and
    returns 2.
    """

    def run(options: argparse.Namespace, is_stopped: Callable[[], bool]) -> int:
        replay = ContactReplay(name, options, is_stopped)
        print(replay.execute())
        for failure in replay.failures.values():
            print_error(name, failure)
        return USER_ERROR if replay.failures else 0

    return run_replay(replay_parser(name), name, arguments, run, 'nothing was written')


_OPTIONS: tuple[Option, ...] = (
    ('--bag', {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'recordings to search for contact of the moving or resting arm: bags, .csv and .npz files'),
    ('--free', {'nargs': '+', 'type': Path, 'default': [], 'metavar': 'DIR'},
        'recordings without contact and payload, from which the program learns the contact '
        'thresholds'),
    ('--residuals', {'type': Path, 'metavar': 'FILE'},
        f'file {RESIDUALS} with the contact thresholds of an earlier run, instead of --free'),
    ('--model', {'type': Path, 'metavar': 'FILE'},
        'identified model of the arm, estimate.yaml (default: the model in the URDF)'),
    ('--payload', {'nargs': 4, 'type': float, 'metavar': ('KG', 'X', 'Y', 'Z')},
        'payload that the arm carries in all recordings of --bag: mass [kg], and centre of mass in '
        'the frame of the last joint [m] (default: no payload)'),
    ('--out', {'type': Path, 'metavar': 'DIR'}, f'folder for {REPORT} and {RESIDUALS}'),
)  # fmt: skip


def replay_parser(name: str) -> OneLineParser:
    """Return the parser of the options of `contact_estimator --bag`."""
    parser = table_parser(name, 'Find contact in recordings.', _OPTIONS)
    add_arm_options(parser)
    add_parameters(parser, _PARAMETERS)
    return parser


@dataclass(frozen=True, eq=False)
class SearchedBag:
    """Contact events that the search found in one recording.

    Attributes
    ----------
    places : list of ContactPlace or None
        Link, point and force of each contact; None for other events.
    torque, threshold : (M, n) ndarray
        External torque and its threshold [Nm].
    problems : dict of str to list of (float, float)
        Reasons why contact cannot be detected, with the first and last time [s] of each interval.
    """

    recording: Recording
    events: list[ContactEvent]
    places: list[ContactPlace | None]
    torque: Array
    threshold: Array
    problems: Mapping[str, list[tuple[float, float]]]

    def event_texts(self) -> list[str]:
        """Return one line per event."""
        names = self.recording.joint_names
        rows = zip(self.events, self.places, strict=True)
        return [event_text(event, place, names) for event, place in rows]


class ContactReplay:
    """Search for contact with the options of the command line.

    Parameters
    ----------
    name : str
        Program name, for messages.
    options : argparse.Namespace
        Options of `replay_parser`.

    Attributes
    ----------
    failures : dict of str to Exception
        Reasons why recordings of `--bag` could not be searched completely, by their paths.

    Raises
    ------
    IdentificationError, DescriptionError, ConfigError
        If an option, the URDF, the configuration or the model is wrong.
    """

    def __init__(
        self, name: str, options: argparse.Namespace, is_stopped: Callable[[], bool]
    ) -> None:
        self._name = name
        self._options = options
        self._is_stopped = is_stopped
        self.failures: dict[str, Exception] = {}
        check_parameters(options, _PARAMETERS)
        if bool(options.free) == (options.residuals is not None):
            raise IdentificationError(
                'the search needs contact thresholds from exactly one source: pass --free BAG '
                'with motion without contact, for example the bag of the identification, or pass '
                f'--residuals {RESIDUALS}'
            )
        if not options.bag and not (options.free and options.out):
            raise IdentificationError(
                'there is no recording to search: pass --bag, or pass --free and --out to learn '
                'thresholds only'
            )
        self._payload = _body(options.payload)
        self._recorded = RecordedArm(options, [*options.free, *options.bag], whole=True)
        self._arm, _ = known_arm(self._recorded, options)

    def execute(self) -> str:
        """Learn the thresholds, search the recordings, and return the found events as text.

        Raises
        ------
        IdentificationError, BagError
            If no bag can be searched, or the result cannot be written.
        """
        if self._options.out is None:
            return self._text(self._search(self._bound()))
        with ResultDirectory(self._options.out, files=_FILES) as directory:
            bound = self._bound()
            bags = self._search(bound)
            values = bound.to_dict(self._arm.robot.joint_names)
            directory.write(RESIDUALS, yaml.safe_dump({RESIDUALS_SECTION: values}, sort_keys=False))
            directory.write(REPORT, contact_page(bags, self.failures))
            failures = {path: str(error) for path, error in self.failures.items()}
            summary = {'contacts': [_summary(bag) for bag in bags], 'failures': failures}
            directory.write_json(MARKER, summary)
        return f'{self._text(bags)}\nReport: {directory.target / REPORT}'

    def _bound(self) -> ResidualBound:
        if self._options.residuals is not None:
            return read_residuals(self._options.residuals, self._arm.robot.joint_names)
        gain, rows = self._options.observer_gain, []
        recordings = [self._recorded.recording(path) for path in self._options.free]
        for recording in recordings:
            rows += list(free_rows(ExternalTorque(self._arm, gain), recording, self._is_stopped))
        bound = ResidualBound.learnt(rows, gain)
        for recording in recordings:
            learnt = with_rest_share(
                bound,
                lambda: ExternalTorque(self._arm, gain),
                partial(recorded_states, recording),
                contact_settings(self._options),
            )
            bound = max(bound, learnt, key=lambda one: one.rest_share)
        return bound

    def _search(self, bound: ResidualBound) -> list[SearchedBag]:
        """Search all bags; if no bag can be searched, raise the error of the last bag."""
        bags: list[SearchedBag] = []
        for path in self._options.bag:
            try:
                bags.append(self._search_one(path, bound))
            except (ValueError, OSError) as error:
                self.failures[str(path)] = error
                continue
            if problems := bags[-1].problems:
                texts = [f'{_times(times)}: {text}' for text, times in problems.items()]
                self.failures[str(path)] = IdentificationError(f'{path.name}: {"; ".join(texts)}')
        if self.failures and not bags:
            for failure in list(self.failures.values())[:-1]:
                print_error(self._name, failure)
            raise self.failures.popitem()[1]
        print_notice(self._name, *self._recorded.messages)
        return bags

    def _search_one(self, path: Path, bound: ResidualBound) -> SearchedBag:
        recording, limit = self._recorded.recording(path), self._arm.robot.effort_max
        # A limit that many recorded torques exceed is not the limit of the recorded drive.
        largest = np.nanquantile(np.abs(recording.tau), _TORQUE_QUANTILE, axis=0)
        limit = np.where(largest > _LIMIT_FACTOR * limit, np.inf, limit)
        external = ExternalTorque(self._arm, bound.gain)
        detector = ContactDetector(external, bound, contact_settings(self._options), limit)
        if self._payload is not None:
            detector.carry(self._payload)
        locator = ContactLocator(self._arm.robot)
        return search(recording, detector, locator, self._is_stopped)

    def _text(self, bags: Sequence[SearchedBag]) -> str:
        lines = []
        for bag in bags:
            count = sum(event.cause is Cause.CONTACT for event in bag.events)
            lines.append(
                f'{bag.recording.name}: {bag.recording.duration:.1f} s, {count} '
                f'contact{"" if count == 1 else "s"}'
            )
            lines += [f'  {text}' for text in bag.event_texts()]
        return '\n'.join(lines)


def _body(given: Sequence[float] | None) -> Array | None:
    """Return the inertial parameters (10,) of the payload of `--payload`, None without payload."""
    if given is None:
        return None
    mass, *centre = given
    if not (np.isfinite(given).all() and mass > 0.0):
        raise IdentificationError(
            f'--payload {" ".join(f"{value:g}" for value in given)} is invalid: pass a positive '
            'mass [kg], and the three coordinates of the centre of mass [m]'
        )
    return ball(mass, centre, _PAYLOAD_RADIUS)


def search(
    recording: Recording,
    detector: ContactDetector,
    locator: ContactLocator,
    is_stopped: Callable[[], bool] = lambda: False,
) -> SearchedBag:
    """Return the contact events of one recording of an arm on a fixed base.

    Raises
    ------
    IdentificationError
        If the recording has no velocities.
    """
    problems: dict[str, list[tuple[float, float]]] = {}
    known: dict[str, str] = {}
    torque = np.zeros_like(recording.q)
    threshold = np.full_like(recording.q, np.nan)
    for row, (time, state) in enumerate(recorded_states(recording, is_stopped)):
        report = detector.update(state, time)
        if report is not None:
            torque[row], threshold[row] = report.torque, report.threshold
        if problem := detector.problem:
            times = problems.setdefault(known.setdefault(_NUMBER.sub('', problem), problem), [])
            if times and time - times[-1][1] < _PROBLEM_GAP:
                times[-1] = times[-1][0], time
            else:
                times.append((time, time))
    places = [
        locator.locate(event.q, event.torque, event.threshold)
        if event.cause is Cause.CONTACT
        else None
        for event in detector.events
    ]
    return SearchedBag(recording, detector.events, places, torque, threshold, problems)


def _times(intervals: Sequence[tuple[float, float]]) -> str:
    """Return a text with the first three time intervals and the number of further intervals."""
    texts = [f'{begin:.2f} to {end:.2f} s' for begin, end in intervals[:_LISTED_INTERVALS]]
    more = len(intervals) - len(texts)
    return ', '.join(texts) + (f' and {more} more' if more else '')


def event_text(event: ContactEvent, place: ContactPlace | None, names: Sequence[str]) -> str:
    """Return one line with time, cause, torque and force of an event."""
    end = 'the end' if math.isnan(event.end) else f'{event.end:.2f} s'
    text = f'{event.begin:.2f} s to {end}: {event.cause.value}'
    if event.cause is Cause.PAYLOAD:
        return (
            f'{event.begin:.2f} s: {event.cause.value} of {event.mass:.3g} ± '
            f'{event.mass_std:.2g} kg on the last link, identified '
            f'{event.end - event.begin:.2g} s later'
        )
    size = float(event.torque[event.joint])
    text = (
        f'{text}, torque of {names[event.joint]} {size:+.3g} Nm ({event.ratio:.2g} times the '
        'threshold)'
    )
    if place is None:
        return text
    force = f'{np.linalg.norm(place.force):.3g} N at {place.link}'
    return f'{text}, force {force if place.is_determined else f"at least {force}"}'


def _summary(bag: SearchedBag) -> dict[str, Any]:
    return {
        'recording': bag.recording.name,
        'duration': round(bag.recording.duration, 3),
        'events': [
            {
                'cause': event.cause.value,
                'begin': round(event.begin, 4),
                'end': None if math.isnan(event.end) else round(event.end, 4),
                'joint': bag.recording.joint_names[event.joint],
                'torque': event.torque.round(4).tolist(),
                **({} if place is None else _place(place)),
            }
            for event, place in zip(bag.events, bag.places, strict=True)
        ],
    }


def _place(place: ContactPlace) -> dict[str, Any]:
    """Return force [N, axes of the base] and point [m, frame of the link] of a contact."""
    point, force = place.point.round(3).tolist(), place.force.round(3).tolist()
    return {
        'link': place.link,
        'point': point,
        'force': force,
        'force_is_determined': bool(place.is_determined),
    }


def contact_page(bags: Sequence[SearchedBag], failures: Mapping[str, Exception]) -> str:
    """Return the HTML page with the events and torque curves of each recording, and all errors."""
    parts: list[str] = []
    if failures:
        reasons = bullets([str(error) for error in failures.values()])
        parts.append(section('Recordings that were not searched completely', reasons))
    for number, bag in enumerate(bags):
        heading = f'{bag.recording.name} ({bag.recording.duration:.1f} s)'
        events = bullets(bag.event_texts()) if bag.events else paragraph('No event.')
        parts.append(section(heading, events, _figure(number, bag)))
    legend = (
        'Torque: largest change of the external torque during the event, positive along the joint. '
        'While the arm rests, also torques below the threshold count as contact. Force: the '
        'single force that explains the torque; "at least" marks a force that may have a further '
        'component without any joint torque. Solid curves show the external torque, dashed curves '
        'its threshold. Red areas mark contact, green areas a payload, grey areas a model error.'
    )
    return page('Contacts', plotting_script(), [*parts, paragraph(legend, 'note')], origin())


def _figure(number: int, bag: SearchedBag) -> Html:
    figure = StackedFigure(bag.recording.joint_names, 'Nm', most=_PLOT_POINTS)
    for joint in range(bag.torque.shape[1]):
        bound = bag.threshold[:, joint]
        figure.add(joint, bag.recording.time, bag.torque[:, joint], 'external torque', 'predicted')
        for side in (bound, -bound):
            figure.add(joint, bag.recording.time, side, 'threshold', 'reference', 'dash')
    last = float(bag.recording.time[-1])
    areas = [
        {
            'type': 'rect', 'xref': 'x', 'yref': 'paper', 'y0': 0, 'y1': 1, 'opacity': 0.2,
            'x0': event.begin, 'x1': last if math.isnan(event.end) else event.end,
            'fillcolor': _COLOUR[event.cause], 'line': {'width': 0},
        }
        for event in bag.events
    ]  # fmt: skip
    return figure.html(f'bag{number}', areas)
