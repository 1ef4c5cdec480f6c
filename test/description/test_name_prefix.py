import pytest

from aerarm_ros.description.config_reader import DescriptionError, check_prefix


@pytest.mark.parametrize('prefix', ['', 'left_', 'left/', 'fleet/arm2_', 'L'])
def test_valid_prefixes_are_accepted(prefix: str) -> None:
    check_prefix(prefix)


@pytest.mark.parametrize(
    'prefix',
    ['/left', '_', '1st_', 'left arm', 'left//', 'left-', 'léft_', '{left}', 'a\n', 65 * 'a'],
)
def test_invalid_prefixes_are_rejected(prefix: str) -> None:
    with pytest.raises(DescriptionError, match='must begin with a letter .* left_'):
        check_prefix(prefix)
