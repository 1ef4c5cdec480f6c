"""Mutants of bags: changed bytes, changed records, edited metadata."""

import re
from collections.abc import Sequence

import mcap_surgery
import numpy as np
from bag_originals import Files, OriginalBag

_MOST_CHANGES = 3


def mutant(bags: Sequence[OriginalBag], index: int, rng: np.random.Generator) -> tuple[Files, str]:
    """Return the files of a mutant of one bag, and a description of the mutation."""
    files = dict(bags[index].files)
    done = []
    for _ in range(int(rng.integers(1, _MOST_CHANGES + 1))):
        names = sorted(files)
        name = names[rng.integers(len(names))]
        if name == 'metadata.yaml' and rng.random() < 0.7:
            name = names[0]
        content = files[name]
        if name == 'metadata.yaml':
            files[name], what = _edited(content, rng)
        elif '.mcap' in name and 'zstd' not in name and rng.random() < 0.6:
            change = mcap_surgery.CHANGES[rng.integers(len(mcap_surgery.CHANGES))]
            files[name], what = change(content, rng), change.__name__
        else:
            files[name], what = _changed_bytes(content, bags, rng)
        done.append(what)
    return files, ', '.join(done)


def _changed_bytes(
    content: bytes, bags: Sequence[OriginalBag], rng: np.random.Generator
) -> tuple[bytes, str]:
    size = len(content)
    if not size:
        return content, 'nothing'
    place = int(rng.integers(size))
    run = int(2 ** rng.uniform(0, 12))
    kind = rng.integers(7)
    if kind == 0:
        changed = bytearray(content)
        for bit in rng.integers(8 * size, size=int(rng.integers(1, 9))):
            changed[bit // 8] ^= 1 << (bit % 8)
        return bytes(changed), 'bits'
    if kind == 1:
        return content[:place], 'cut'
    if kind == 2:
        return content[:place] + content[place + run :], 'taken out'
    if kind == 3:
        noise = rng.integers(0, 256, run, np.uint8).tobytes()
        return content[:place] + noise + content[place + run :], 'noise'
    if kind == 4:
        return content[:place] + bytes(run) + content[place + run :], 'zeros'
    other = content
    if rng.random() < 0.3:
        contents = [file for bag in bags for file in bag.files.values()]
        other = contents[rng.integers(len(contents))]
    start = int(rng.integers(len(other)))
    piece = other[start : start + run]
    behind = place if kind == 5 else place + len(piece)
    return content[:place] + piece + content[behind:], 'spliced'


def _edited(content: bytes, rng: np.random.Generator) -> tuple[bytes, str]:
    text = content.decode(errors='replace')
    lines = text.splitlines(keepends=True)
    if not lines:
        return content, 'nothing'
    line = int(rng.integers(len(lines)))
    kind = rng.integers(10)
    if kind == 0:
        del lines[line]
    elif kind == 1:
        lines.insert(line, lines[rng.integers(len(lines))])
    elif kind == 2:
        lines[line] = re.sub(r':.*', f': {_value(rng)}', lines[line])
    elif kind == 3:
        numbers = list(re.finditer(r'\d+', text))
        if numbers:
            found = numbers[rng.integers(len(numbers))]
            text = text[: found.start()] + _number(rng) + text[found.end() :]
        lines = [text]
    elif kind == 4:
        return _aliases(int(rng.integers(3, 12))), 'aliases'
    elif kind == 5:
        return _opened(rng) * int(rng.integers(1, 60_000)), 'deep'
    elif kind == 6:
        return content + b'x: ' + b'9' * int(rng.integers(1, 100_000)) + b'\n', 'digits'
    elif kind == 7:
        lines[line] = lines[line].replace(':', ': &a', 1) + 'again: *a\n'
    elif kind == 8:
        return content + b'- a\n' * int(rng.integers(1, 200_000)), 'long'
    else:
        return rng.integers(0, 256, int(rng.integers(1, 2000)), np.uint8).tobytes(), 'noise'
    return ''.join(lines).encode(), 'metadata'


def _opened(rng: np.random.Generator) -> bytes:
    return (b'[', b'{a: ', b'- ')[rng.integers(3)]


def _number(rng: np.random.Generator) -> str:
    numbers = ('0', '-1', '7', '1e999', '.inf', '.nan', '1e10000000', '9' * 5000, '0x' + 'f' * 999)
    return numbers[rng.integers(len(numbers))]


def _value(rng: np.random.Generator) -> str:
    values = ('', '[]', '{}', '~', 'true', '2001-99-99', '"' + 'a' * 5000 + '"', '!!int x', '/')
    return values[rng.integers(len(values))] if rng.random() < 0.6 else _number(rng)


def _aliases(depth: int) -> bytes:
    lines = ['a0: &a0 [x, x, x, x, x, x, x, x, x]']
    lines += [f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 9)}]' for k in range(1, depth)]
    lines += [f'rosbag2_bagfile_information: *a{depth - 1}']
    return '\n'.join(lines).encode()
