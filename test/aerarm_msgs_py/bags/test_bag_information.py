"""Valid and invalid metadata.yaml files."""

import os
import time
import tracemalloc
import warnings
from pathlib import Path

import pytest

from aerarm_msgs_py.bags.bag import BagInformation, read_information
from aerarm_msgs_py.bags.bag_reader import read_joint_states
from aerarm_msgs_py.storage.read_limits import BagWarning

HEAD = 'rosbag2_bagfile_information:\n  '
BOMB = 'a0: &a0 [x, x, x, x, x, x, x, x, x]\n' + '\n'.join(
    f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 9)}]' for k in range(1, 12)
)
REFUSED = {
    'aliases': (BOMB, 'anchors or aliases'),
    'lists': ('[' * 200_000, 'nested more than 16 levels deep'),
    'mappings': ('{a: ' * 100_000, 'nested more than 16 levels deep'),
    'digits': (HEAD + 'version: ' + '9' * 100_000, 'a number of 100000 characters'),
    'base 60': (HEAD + 'version: 1' + ':1' * 500_000, 'a number of 1000001 characters'),
    'base 60 by a tag': (HEAD + f'a: !!int "_1{":1" * 500_000}"', 'a number of 1000002 characters'),
    'an empty number': (HEAD + 'a: !!int ""', 'index out of range'),
    'no truth': (HEAD + 'a: !!bool x', 'x'),
    'no time': (HEAD + 'a: !!timestamp x', 'groupdict'),
    'length': ('- a\n' * 400_000, 'larger than 1048576 bytes'),
    'a date': (HEAD + 'version: 2001-99-99', 'month must be in'),
    'no mapping': ('[]', 'not the metadata of a bag'),
    'a number of files': (HEAD + 'relative_file_paths: 7', 'not the metadata of a bag'),
    'a null': (HEAD.rstrip(), 'not the metadata of a bag'),
    'no text': (b'\xff\xfe', 'invalid start byte'),
}


def written(folder: Path, content: str | bytes) -> Path:
    path = folder / 'metadata.yaml'
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


@pytest.mark.parametrize('name', REFUSED)
def test_yaml_that_needs_much_memory_or_time_is_rejected(tmp_path: Path, name: str) -> None:
    content, message = REFUSED[name]
    path = written(tmp_path, content)
    tracemalloc.start()
    before = time.process_time()
    with pytest.raises(ValueError, match=message) as caught:
        read_information(path)
    assert time.process_time() - before < 2.0
    assert tracemalloc.get_traced_memory()[1] < 30_000_000
    tracemalloc.stop()
    assert '\n' not in str(caught.value)
    assert len(str(caught.value)) <= 200


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / 'metadata.yaml'
    os.mkfifo(pipe)
    with pytest.raises(ValueError, match='instead of a regular file'):
        read_information(pipe)


def test_a_missing_file_raises_another_error_than_a_broken_one(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_information(tmp_path / 'metadata.yaml')


@pytest.mark.parametrize('count', ['-1', '.inf', '1.5', 'true', '~', '"7"', '[1]', '9' * 30])
def test_an_invalid_message_count_is_ignored(tmp_path: Path, count: str) -> None:
    entry = f'{{topic_metadata: {{name: /a}}, message_count: {count}}}'
    path = written(tmp_path, f'{HEAD}topics_with_message_count: [{entry}]')
    assert read_information(path) == BagInformation()


@pytest.mark.parametrize('name', ['..', '/', '""', '"a\\0b"', 'a' * 300, '7'])
def test_a_file_has_the_name_of_a_file(tmp_path: Path, name: str) -> None:
    path = written(tmp_path, f'{HEAD}relative_file_paths: [../up/b.mcap, b.mcap, {name}]')
    if name == '7':
        with pytest.raises(ValueError, match='not the metadata'):
            read_information(path)
    else:
        assert read_information(path).files == ('b.mcap',)


def test_a_bag_with_broken_metadata_is_read_from_its_mcap_file(write_bag, recording) -> None:
    directory = write_bag(recording.messages(100))
    written(directory, BOMB)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert len(read_joint_states(directory)) == 100
    file = next(directory.glob('*.mcap'))
    content = file.read_bytes()
    file.write_bytes(content[: content.index(b'rosbag2')])  # the account is lost with the end
    with pytest.warns(
        BagWarning, match='ignores .*metadata.yaml: the file contains YAML anchors or aliases'
    ):
        assert len(read_joint_states(directory)) == 100
