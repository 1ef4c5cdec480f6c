"""Table of the errors of all flights of a flight campaign."""

from collections.abc import Mapping
from pathlib import Path

from flying.flight_program import FlightProgram
from flying.flight_record import FlightFigures, FlightRecord
from flying.flight_way import load_drone
from flying.tilt_limit import tilt_limit

COLUMNS = (
    'place RMS [mm]',
    'largest',
    'tilt RMS [deg]',
    'largest',
    'heading, largest [deg]',
    'tool RMS [mm]',
    'largest',
    'time with a rotor at a limit [%]',
)
BASELINE, OBSERVERS, BEST = 'integral', ('observer', 'INDI'), 'posture, motion, lead'
# [mm] largest RMS of the best method, [deg].
GOALS = {
    ('hexarotor', 'slow'): 6.0,
    ('hexarotor', 'fast'): 40.0,
    ('tilted_hexarotor', 'slow'): 4.0,
    ('tilted_hexarotor', 'fast'): 5.0,
}
_LINE = '{:17} {:24} {:17} {:>8} {:>7} {:>7} {:>6} {:>7} {:>8} {:>7} {:>7}'
_HEADINGS = ('place mm', 'max', 'tilt deg', 'max', 'heading', 'tool mm', 'max', 'limit %')


class FlightResults:
    """Flights of several drones with several feed-forward methods, and their errors.

    Attributes
    ----------
    records : mapping
        Record by drone and method, or the reason of a failure.
    tilt_limits : dict
        Values of `tilt_limit` by drone, for the arm of that URDF.
    figures : dict
        Figures by drone, method and part; None if the drone was lost.
    """

    def __init__(
        self,
        program: FlightProgram,
        records: Mapping[str, Mapping[str, FlightRecord | str]],
        urdf: Path | None = None,
    ) -> None:
        self.program, self.records = program, records
        self.tilt_limits = {name: tilt_limit(load_drone(name), program, urdf) for name in records}
        self.figures: dict[tuple[str, str, str], FlightFigures | None] = {}
        for drone, flights in records.items():
            config = load_drone(drone)
            for way, record in flights.items():
                for part, window in program.windows.items():
                    found = None
                    if not isinstance(record, str):
                        found = record.part(*window).figures(program.motion, config)
                    self.figures[drone, way, part] = found

    def ratio(self, drone: str, part: str, others: tuple[str, ...]) -> float | None:
        """Return the smallest error of `others`, divided by that of full feed-forward."""
        best = self.figures.get((drone, BEST, part))
        found = [self.figures.get((drone, way, part)) for way in others]
        places = [figures.place for figures in found if figures is not None]
        return min(places) / best.place if best and places else None

    def text(self) -> str:
        """Return the table of errors, with the improvement by full feed-forward."""
        lines = [_LINE.format('drone', 'method', 'motion', *_HEADINGS)]
        lost = ['lost', *['-'] * (len(COLUMNS) - 1)]
        for (drone, way, part), figures in self.figures.items():
            shown = lost if figures is None else [f'{x:.2f}' for x in figures]
            lines.append(_LINE.format(drone, way, part, *shown))
        for drone, flights in self.records.items():
            reasons = {way: text for way, text in flights.items() if isinstance(text, str)}
            lines += [f'{drone}, {way}: {text}' for way, text in reasons.items()]
            lines += [f'{drone}, {", ".join(row)}' for row in self.ratios(drone)]
        return '\n'.join(lines)

    def ratios(self, drone: str) -> list[tuple[str, ...]]:
        """Return for each part the improvement by full feed-forward, and its limit."""
        rows = []
        for part in list(self.program.windows)[1:]:
            over = [self.ratio(drone, part, ways) for ways in ((BASELINE,), OBSERVERS)]
            shown = ['-' if value is None else f'{value:.1f}' for value in over]
            row = (
                part,
                f'{shown[0]} = error with integral / error with full feed-forward',
                f'{shown[1]} = error with observer or INDI / error with full feed-forward',
            )
            limit = self.tilt_limits[drone].get(part)
            rows.append(
                row if limit is None else (*row, f'error caused by the tilt alone {limit:.1f} mm')
            )
        return rows
