import pytest

from aerarm_ros.description.config_reader import DescriptionError, check_prefix


@pytest.mark.parametrize('prefix', ['', 'left_', 'left/', 'fleet/arm2_', 'L'])
def test_what_frames_may_begin_with(prefix: str) -> None:
    check_prefix(prefix)


@pytest.mark.parametrize(
    'prefix',
    ['/left', '_', '1st_', 'left arm', 'left//', 'left-', 'léft_', '{left}', 'a\n', 65 * 'a'],
)
def test_what_cannot_stand_before_names_is_refused(prefix: str) -> None:
    with pytest.raises(DescriptionError, match='must begin with a letter .* left_'):
        check_prefix(prefix)
