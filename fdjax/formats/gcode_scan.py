"""The lines of a G-code file many at a time: which are plain motion, and the numbers in them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Mask = NDArray[np.bool_]

_BLOCK = 1 << 20
"""Bytes looked at together: some forty arrays of them are alive at once."""
_LONGEST = 15
"""Digits whose whole number a double holds exactly, so that dividing by ten rounds as `float`."""
LETTERS = b"XYZEF"

_NUMBER, _BLANK, _LETTER, _OTHER = range(4)
_CLASS = np.full(256, _OTHER, np.uint8)
_CLASS[list(b"0123456789.-")] = _NUMBER
_CLASS[32] = _BLANK
_CLASS[list(LETTERS)] = _LETTER
_CODE = np.zeros(256, np.uint8)
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
    kinds = _CLASS[array]
    plain, words = _words(array, kinds, read, start, inner, stop)
    only_e = plain & resets & np.isfinite(words[:, 3]) & np.isnan(words[:, [0, 1, 2, 4]]).all(1)
    plain &= moves
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
    array: NDArray[np.uint8],
    kinds: NDArray[np.uint8],
    read: Mask,
    start: Ints,
    inner: Ints,
    stop: Ints,
) -> tuple[Mask, Floats]:
    """Which of the lines to read hold nothing but plain words, and the words."""
    count = len(start)
    words = np.full((count, len(LETTERS)), np.nan)
    others = np.concatenate([[0], np.cumsum(kinds == _OTHER, dtype=np.int32)])
    good = read & (others[stop] == others[np.minimum(inner, stop)])
    letters = np.flatnonzero(kinds == _LETTER)
    line = np.searchsorted(start, letters, side="right") - 1
    own = good[line] & (letters >= inner[line]) & (letters < stop[line])
    letters, line = letters[own], line[own]
    blanks = np.flatnonzero(kinds == _BLANK)
    if not len(letters):
        return good & False, words
    after = np.append(blanks, len(array))[np.searchsorted(blanks, letters)]
    length = np.minimum(after, stop[line]) - letters - 1
    value, sound = _numbers(array, letters + 1, length)
    sound &= array[letters - 1] == 32
    good[line[~sound]] = False
    code = _CODE[array[letters]]
    once = np.bincount(line * len(LETTERS) + code, minlength=count * len(LETTERS))
    once = once.reshape(count, len(LETTERS))
    gaps = np.searchsorted(blanks, stop) - np.searchsorted(blanks, inner)
    good &= (once.max(1) == 1) & (gaps == once.sum(1))
    words[line, code] = value
    words[~good] = np.nan
    return good, words


def _numbers(array: NDArray[np.uint8], at: Ints, length: Ints) -> tuple[Floats, Mask]:
    """The numbers of these lengths, and which are numbers; exactly as `float` reads them."""
    sound = (length > 0) & (length <= _LONGEST)
    length = np.where(sound, length, 0)
    value = np.zeros(len(at))
    point = length.copy()
    points = np.zeros(len(at), np.uint8)
    digits = np.zeros(len(at), np.uint8)
    negative = sound & (array[at] == ord("-"))
    for place in range(int(length.max(initial=0))):
        sign = array[at + place]
        within = place < length
        digit = within & (sign >= 48) & (sign <= 57)
        value = np.where(digit, value * 10 + (sign - 48.0), value)
        digits += digit
        dot = within & (sign == ord("."))
        points += dot
        point = np.where(dot, place + 1, point)
        if place:
            sound &= ~(within & (sign == ord("-")))
    # A point at the end is no number for the interpreter's plain lines; leave it to the others.
    sound &= (digits > 0) & (points <= 1) & ~((points == 1) & (point == length))
    value /= _POWERS[np.clip(length - point, 0, _LONGEST)]
    return np.where(negative, -value, value), sound
