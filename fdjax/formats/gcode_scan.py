"""The lines of a G-code file many at a time: which are plain motion, and the numbers in them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Mask = NDArray[np.bool_]

_BLOCK = 1 << 19
"""Bytes looked at together: some forty arrays of them are alive at once."""
_LONGEST = 15
"""Digits whose whole number a double holds exactly, so that dividing by ten rounds as `float`."""
LETTERS = b"XYZEF"

_CODE = np.full(256, len(LETTERS), np.uint8)
_CODE[list(LETTERS)] = np.arange(len(LETTERS))
_POWERS = 10.0 ** np.arange(_LONGEST + 1)


@dataclass(frozen=True, eq=False)
class Block:
    """Some lines of a file, one after the other.

    - `data`: their bytes; `first`: number of the first; `start`, `end`: where each begins and ends.
    - `plain`: lines `G0` or `G1` with words X, Y, Z, E, F, each at most once and apart by one
      blank, that go on with nothing but a comment. `resets`: lines `G92 E` with a number.
      `comments`: lines that begin with a semicolon. `others`: what is neither of these nor empty.
    - `words`: X, Y, Z, E, F of the plain lines and resets, shape (lines, 5), nan where not given.
    """

    data: bytes
    first: int
    start: Ints
    end: Ints
    plain: Mask
    resets: Mask
    comments: Mask
    others: Mask
    words: Floats

    def text(self, index: int) -> str:
        """A line without its end."""
        return self.data[self.start[index] : self.end[index]].decode(errors="replace")


def blocks(data: bytes) -> Iterator[Block]:
    """The lines of a file in blocks.

    >>> [block] = blocks(b"G1 X10 Y-.5 ; to there\\nM83\\n")
    >>> block.plain.tolist(), block.words[0].tolist()[:2]
    ([True, False], [10.0, -0.5])
    """
    at, first = 0, 1
    while at < len(data):
        stop = len(data)
        if at + _BLOCK < stop:
            stop = data.find(b"\n", at + _BLOCK) + 1 or stop
        block = _block(data[at:stop], first)
        yield block
        at, first = stop, first + len(block.start)


def _block(data: bytes, first: int) -> Block:
    if not data.endswith(b"\n"):
        data += b"\n"
    # Behind the last line there is room to look a few bytes further.
    array = np.frombuffer(data + b"\n" * (_LONGEST + 2), np.uint8)
    end = np.flatnonzero(array[: len(data)] == 10)
    start = np.concatenate([[0], end[:-1] + 1])
    head, second, third = array[start], array[start + 1], array[start + 2]
    is_g = head == ord("G")
    moves = is_g & ((second == ord("0")) | (second == ord("1"))) & (third == 32)
    resets = is_g & (second == ord("9")) & (third == ord("2")) & (array[start + 3] == 32)
    comments = head == ord(";")
    read = moves | resets
    inner = start + np.where(resets, 3, 2)
    stop = _contents(array, start, end)
    plain, words = _words(array, read, start, inner, stop)
    only_e = plain & resets & np.isfinite(words[:, 3]) & np.isnan(words[:, [0, 1, 2, 4]]).all(1)
    plain &= moves & ~(words[:, 4] <= 0)  # what no speed is differs
    others = ~(plain | only_e | comments)
    others[others] = array[start[others]] != 10
    return Block(data, first, start, end, plain, only_e, comments, others, words)


def _contents(array: NDArray[np.uint8], start: Ints, end: Ints) -> Ints:
    """Where each line ends, without comment and blanks."""
    stop = end.copy()
    signs = np.flatnonzero(array == ord(";"))
    if len(signs):
        following = np.append(signs, len(array))[np.searchsorted(signs, start)]
        stop = np.minimum(following, end)
    for _ in range(3):
        last = array[stop - 1]
        stop -= (stop > start) & ((last == 32) | (last == 9))
    return stop


def _words(
    array: NDArray[np.uint8], read: Mask, start: Ints, inner: Ints, stop: Ints
) -> tuple[Mask, Floats]:
    """Which of the lines to read hold nothing but plain words, and the words."""
    count, kinds = len(start), len(LETTERS)
    words = np.full((count, kinds), np.nan)
    codes = _CODE[array]
    letters = np.flatnonzero(codes < kinds)
    each = np.diff(np.searchsorted(letters, np.append(start, len(array))))
    line = np.repeat(np.arange(count, dtype=np.int32), each)
    own = read[line] & (letters < stop[line])
    letters, line = letters[own], line[own]
    if not len(letters):
        return np.zeros(count, bool), words
    # Blanks stand where the words must, before each letter: so each ends before the next.
    follows = line[1:] == line[:-1]
    end = stop[line]
    end[:-1][follows] = letters[1:][follows] - 1
    value, sound = _numbers(array, letters + 1, end - letters - 1)
    sound &= array[letters - 1] == 32
    head = np.append(True, ~follows)
    sound[head] &= letters[head] == inner[line[head]] + 1
    code = codes[letters]
    once = np.bincount(line * kinds + code, minlength=count * kinds).reshape(count, kinds)
    good = once.max(1) == 1
    good[line[~sound]] = False
    words[line, code] = value
    words[~good] = np.nan
    return good, words


def _numbers(array: NDArray[np.uint8], at: Ints, length: Ints) -> tuple[Floats, Mask]:
    """The numbers of these lengths, and which are numbers; exactly as `float` reads them."""
    sound = (length > 0) & (length <= _LONGEST)
    size = np.where(sound, length, 0).astype(np.int8)
    negative = sound & (array[at] == ord("-"))
    value = np.zeros(len(at))
    point = size.copy()
    digits, points = np.zeros((2, len(at)), np.int8)
    for place in range(int(size.max(initial=0))):
        sign = array[at + place]
        within = place < size
        digit = (sign - 48 < 10) & within  # in bytes, where what is less than 0 is large
        np.multiply(value, 10, out=value, where=digit)
        np.add(value, sign - 48.0, out=value, where=digit)
        digits += digit
        dot = (sign == ord(".")) & within
        points += dot
        point[dot] = place + 1
    # A point at the end is no number for the interpreter's plain lines; leave it to the others.
    sound &= (digits > 0) & (points <= 1) & ~((points == 1) & (point == size))
    sound &= digits + points + negative == size
    value /= _POWERS[size - point]
    return np.where(negative, -value, value), sound
