"""The table a user sees in the terminal."""

from types import SimpleNamespace

from aerarm_ros.identification.recording.recording import BagFacts
from aerarm_ros.ros.programs.identifier_run import terminal_table


def column(name: str) -> SimpleNamespace:
    return SimpleNamespace(samples=SimpleNamespace(name=name))


def solution(consistent: bool, *errors: float) -> SimpleNamespace:
    bags = [
        SimpleNamespace(filtered=error, filtered_measured=1.5 * error, raw=2.0 * error)
        for error in errors
    ]
    estimate = SimpleNamespace(physically_consistent=consistent)
    return SimpleNamespace(estimate=estimate, identification=bags[:1], validation=bags[1:])


def test_part_and_bag_stand_above_each_column() -> None:
    result = SimpleNamespace(
        identification=[column('monday')],
        validation=[column('a_bag_with_a_long_name')],
        gravity=SimpleNamespace(tilt=0.02),
        solutions={'ols': solution(False, 1.0, 3.0), 'sdp': solution(True, 1.5, 2.5)},
    )
    facts = {'monday': BagFacts('1.0 .. 9.0 s of 10.0 s (motion)', 0, 12)}
    lines = terminal_table(result, facts).splitlines()
    assert lines[1].split() == ['identification', 'validation']
    assert lines[2].split() == ['monday', 'a_bag_with_a_long_name']
    ols = 'ols 1.00 / 1.50 (2.00) 3.00 / 4.50 (6.00) not physically consistent'
    sdp = 'sdp 1.50 / 2.25 (3.00) 2.50 / 3.75 (5.00)'
    assert lines[3].split() == ols.split()
    assert lines[4].split() == sdp.split()
    ends = [
        line.index(word) + len(word)
        for line, word in zip(lines[1:3], ('validation', 'a_bag_with_a_long_name'), strict=True)
    ]
    assert ends[0] == ends[1]
    used = 'monday: used 1.0 .. 9.0 s of 10.0 s (motion), 0 states lost, 12 cycles missed'
    assert lines[5].startswith('the estimated gravity differs by 1.15 degrees from the direction')
    assert lines[6] == used
