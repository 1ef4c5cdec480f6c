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
COUNT = HEAD + 'topics_with_message_count: [{{topic_metadata: {{name: /a}}, message_count: {}}}]'
CASES: dict[str | bytes, str | BagInformation] = {
    f'{BOMB}\nrosbag2_bagfile_information: *a11': 'not the metadata of a bag',
    f'{BOMB}\n{HEAD}compression_mode: *a11': BagInformation(),
    '[' * 200_000: 'nest',
    '{a: ' * 100_000: 'nest',
    '- ' * 60_000: 'nest',
    '- a\n' * 400_000: 'larger than 1048576 bytes',
    '[]': 'not the metadata of a bag',
    HEAD.rstrip(): 'not the metadata of a bag',
    HEAD + '[broken': 'expected',
    b'\xff\xfe': 'invalid start byte',
    # Values that PyYAML would convert slowly, or with another exception.
    HEAD + 'version: ' + '9' * 100_000: BagInformation(),
    HEAD + f'a: !!int "_1{":1" * 500_000}"': BagInformation(),
    HEAD + 'a: !!bool x\n  b: 2001-99-99': BagInformation(),
    COUNT.format(12): BagInformation(counts={'/a': 12}),
    **{
        COUNT.format(count): BagInformation()
        for count in ('-1', '.inf', '1.5', 'true', '~', '[1]', '9' * 30)
    },
}


@pytest.mark.parametrize('content', CASES, ids=range(len(CASES)))
def test_metadata_is_read_or_rejected_in_limited_time_and_memory(tmp_path, content) -> None:
    path = tmp_path / 'metadata.yaml'
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    expected = CASES[content]
    tracemalloc.start()
    before = time.process_time()
    if isinstance(expected, BagInformation):
        assert read_information(path) == expected
    else:
        with pytest.raises(ValueError, match=expected) as caught:
            read_information(path)
        assert '\n' not in str(caught.value)
        assert len(str(caught.value)) <= 200
    assert time.process_time() - before < 2.0
    assert tracemalloc.get_traced_memory()[1] < 30_000_000
    tracemalloc.stop()


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / 'metadata.yaml'
    with pytest.raises(FileNotFoundError):
        read_information(pipe)
    os.mkfifo(pipe)
    with pytest.raises(ValueError, match='instead of a regular file'):
        read_information(pipe)


def test_a_bag_with_broken_or_no_metadata_is_read_from_its_mcap_file(write_bag) -> None:
    directory = write_bag()
    file, metadata = next(directory.glob('*.mcap')), directory / 'metadata.yaml'
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        assert len(read_joint_states(directory)) == 100
        metadata.write_text(BOMB)
        assert len(read_joint_states(directory)) == 100
        assert len(read_joint_states(file)) == 100
    content = file.read_bytes()
    file.write_bytes(content[: content.index(b'rosbag2')])  # the counts are lost with the end
    with pytest.warns(BagWarning, match='ignores .*metadata.yaml: the file is not the metadata'):
        assert len(read_joint_states(directory)) == 100
    metadata.unlink()
    file.write_bytes(content)
    assert len(read_joint_states(directory)) == 100
