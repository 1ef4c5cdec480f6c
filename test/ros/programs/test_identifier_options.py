"""What the identifier is asked for is what was written."""

from pathlib import Path

from aerarm_ros.ros.programs.identifier_options import identifier_parser


def test_lists_that_are_given_twice_add_up() -> None:
    parser = identifier_parser('identifier', 'Identifies.')
    options = parser.parse_args(
        [
            *('--bag', 'a', 'b', '--bag', 'c', '--validation', 'd', '--validation', 'e'),
            *('--payload', 'f', '--payload', 'g', '--coupled', 'x=y', '--coupled', 'y=x'),
        ]
    )
    assert options.bag == [Path('a'), Path('b'), Path('c')]
    assert options.validation == [Path('d'), Path('e')]
    assert options.payload == [Path('f'), Path('g')]
    assert options.coupled == [('x', 'y'), ('y', 'x')]
    assert parser.parse_args(['--bag', 'z']).bag == [Path('z')]
    assert parser.parse_args([]).bag == []
