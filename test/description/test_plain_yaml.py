"""Malicious YAML: each text is rejected in one line, quickly and with little memory."""

import time
import tracemalloc
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from aerarm_ros.description.config_reader import ConfigError, build, plain_data, read_yaml
from aerarm_ros.description.resources import resource
from aerarm_ros.hardware.frames.frame_profile import ProfileError, load_profile


@dataclass(frozen=True)
class OneNumber:
    value: float


BOMB = 'a0: &a0 [x, x, x, x, x, x, x, x, x]\n' + '\n'.join(
    f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 9)}]' for k in range(1, 12)
)
REFUSED = {
    'aliases': (BOMB, 'anchors and aliases'),
    'an alias of a merge': ('a: &a {b: 1}\nc: {<<: *a}', 'line 1: YAML anchors and aliases'),
    'an anchor alone': ('a: &x 1', 'anchors and aliases'),
    'deep lists': ('a: ' + '[' * 100_000, 'nested more than 20 levels deep'),
    'deep mappings': ('{a: ' * 100_000, 'nested more than 20 levels deep'),
    'deep blocks': ('- ' * 100_000, 'nested more than 20 levels deep'),
    'digits': ('a: ' + '9' * 1_000_000, 'the number has 1000000 characters'),
    'hexadecimal digits': ('a: 0x' + 'f' * 100_000, 'the number has 100002 characters'),
    'base 60': ('a: ' + '59:' * 30_000 + '59', 'the number has 90002 characters'),
    'base 60 by a tag': (f'a: !!int "_1{":1" * 500_000}"', 'the number has 1000002 characters'),
    'a long file': ('a: ' + 'b' * 2_000_000, 'larger than 1048576 bytes'),
    'no date': ('a: 2001-99-99', 'month must be in 1..12'),
    'no number': ('a: !!int x', 'not valid YAML'),
    'a key twice': ('a: 1\nb: 2\na: 3', 'line 3: key a is given twice'),
    'a key twice, deep': ('a: [{b: {c: 1, c: 2}}]', 'line 1: key c is given twice'),
    'a long key twice': (2 * f'{"k" * 900}: 1\n', 'line 2: key k{100} is given twice'),
    'an object': ('a: !!python/object/apply:os.getcwd []', 'not valid YAML'),
    'no YAML': ('a: [', 'not valid YAML'),
    'control characters': ('a: \x00', 'not valid YAML'),
}


@pytest.mark.parametrize('name', REFUSED)
def test_yaml_that_needs_much_memory_or_time_is_rejected(name: str) -> None:
    text, message = REFUSED[name]
    tracemalloc.start()
    before = time.process_time()
    with pytest.raises(ConfigError, match=message) as caught:
        plain_data(text)
    assert time.process_time() - before < 2.0
    assert tracemalloc.get_traced_memory()[1] < 50_000_000
    tracemalloc.stop()
    assert '\n' not in str(caught.value)
    assert len(str(caught.value)) < 500


@pytest.mark.parametrize('name', ['aliases', 'a long file', 'no YAML'])
def test_the_error_of_a_file_names_it(tmp_path: Path, name: str) -> None:
    path = tmp_path / 'some.yaml'
    path.write_text(REFUSED[name][0])
    with pytest.raises(ConfigError, match=r'some\.yaml'):
        read_yaml(path)
    with pytest.raises(ProfileError, match=r'some\.yaml'):
        load_profile(path)


@pytest.mark.parametrize('folder', ['config', 'config/profiles'])
def test_packaged_files_are_read_as_by_safe_load(folder: str) -> None:
    files = sorted(resource(*folder.split('/')).glob('*.yaml'))
    assert files
    for file in files:
        assert plain_data(file.read_text()) == yaml.safe_load(file.read_text())


@pytest.mark.parametrize(
    'ratio', ['1e10000000', '1e999', '1/0', 'nan', '1/' + '3' * 40, '9' * 5000, 'x' * 100_000]
)
def test_a_number_as_text_takes_no_time(ratio: str) -> None:
    with pytest.raises(ConfigError, match='must be a number') as caught:
        build(OneNumber, 'joint', {'value': ratio})
    assert len(str(caught.value)) < 300


def test_profiles_that_extend_each_other_are_refused(tmp_path: Path) -> None:
    first, second = tmp_path / 'first.yaml', tmp_path / 'second.yaml'
    first.write_text(f'name: a\nextends: {second}')
    second.write_text(f'name: b\nextends: {first}')
    with pytest.raises(ProfileError, match='extends itself, or the chain'):
        load_profile(first)


@pytest.mark.parametrize('lsb', ['2^99999999999', '2^-' + '9' * 5000, '.inf'])
def test_a_scale_beyond_all_numbers_is_refused(tmp_path: Path, lsb: str) -> None:
    path = tmp_path / 'own.yaml'
    path.write_text(
        'name: own\nextends: uomodri_v3\n'
        f'command: {{fields: [{{name: enable, word: 0, type: u16, lsb: {lsb}}}]}}'
    )
    with pytest.raises(ProfileError):
        load_profile(path)
