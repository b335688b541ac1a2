"""The lines of a G-code file many at a time: which are plain motion, and the numbers in them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Mask = NDArray[np.bool_]

_BLOCK = 1 << 18
"""Bytes looked at together, so that arrays of what is in them stay near the processor."""
_KEPT = 1 << 24
"""Bytes that all arrays of a block may take together."""
_ROOM = 16
"""Bytes before and behind a block at which may be looked, too."""
_LONGEST = 15
"""Digits whose whole number a double holds exactly, so that dividing by ten rounds as `float`."""
LETTERS = b"XYZEF"

_CODE = np.full(256, len(LETTERS), np.uint8)
_CODE[list(LETTERS)] = np.arange(len(LETTERS))
_POWERS = 10.0 ** np.arange(24)
_ALL = np.uint64(0x0101010101010101)
_TENS = np.array([10**8, 10**7], np.uint64)


@dataclass(frozen=True, eq=False)
class Block:
    """Some lines of a file, one after the other.

    - `data`: their bytes; `first`: number of the first; `start`, `end`: where each begins and ends.
    - `plain`: lines `G0` or `G1` with words X, Y, Z, E, F, each at most once and apart by one
      blank, that go on with nothing but a comment. `resets`: lines `G92 E` with a number.
      `comments`: lines that begin with a semicolon. `others`: what is neither of these nor empty.
    - `words`: X, Y, Z, E, F of the plain lines and resets, shape (5, lines), nan where not given.
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
    >>> block.plain.tolist(), block.words[:2, 0].tolist()
    ([True, False], [10.0, -0.5])
    """
    # Freed memory goes back to the system, at a price, unless as much was in use before at once.
    np.empty(_KEPT, np.uint8)
    at, first = 0, 1
    while at < len(data):
        stop = len(data)
        if at + _BLOCK < stop:
            stop = data.find(b"\n", at + _BLOCK) + 1 or stop
        block = block_of(data[at:stop], first)
        yield block
        at, first = stop, first + len(block.start)


def block_of(data: bytes, first: int) -> Block:
    """Some lines of a file as a block; `first`: number of the first of them."""
    if not data.endswith(b"\n"):
        data += b"\n"
    room = b"\n" * _ROOM
    array = np.frombuffer(room + data + room, np.uint8)
    text = array[_ROOM:]
    # What lies between blanks and ends of lines: commands, words, comments.
    end = np.flatnonzero(text[: len(data)] <= 32)
    mark = text[end]
    closes = mark == 10
    last = np.flatnonzero(closes)
    line_end = end[last]
    start = np.concatenate([[0], line_end[:-1] + 1])
    head, second, third = text[start], text[start + 1], text[start + 2]
    is_g = head == ord("G")
    moves = is_g & ((second == ord("0")) | (second == ord("1"))) & (third == 32)
    resets = is_g & (second == ord("9")) & (third == ord("2")) & (text[start + 3] == 32)
    comments = head == ord(";")
    plain, words = _words(array, end, mark, last, moves | resets)
    only_e = plain & resets & np.isfinite(words[3]) & np.isnan(words[[0, 1, 2, 4]]).all(0)
    plain &= moves & ~(words[4] <= 0)  # what no speed is differs
    others = ~(plain | only_e | comments)
    others[others] = text[start[others]] != 10
    return Block(data, first, start, line_end, plain, only_e, comments, others, words)


def _words(
    array: NDArray[np.uint8], end: Ints, mark: NDArray[np.uint8], last: Ints, read: Mask
) -> tuple[Mask, Floats]:
    """Which of the lines to read hold nothing but plain words, and the words.

    `end`: of each stretch without blanks, `mark` what stands there; `last`: each line's last one.
    """
    text = array[_ROOM:]
    count, kinds = len(last), len(LETTERS)
    begin = np.concatenate([[0], end[:-1] + 1])
    line = np.repeat(np.arange(count), np.diff(last, prepend=-1))
    own = read[line]
    own[0] = own[last[:-1] + 1] = False  # the command itself
    signs = np.flatnonzero(text == ord(";"))
    if len(signs):
        end = _uncomment(signs, begin, end, last, line, read, own)
    _trim(begin, end, mark, own)
    good = read.copy()
    good[line[(mark != 32) & (mark != 10)]] = False
    chosen = np.flatnonzero(own)
    begin, end, line = begin[chosen], end[chosen], line[chosen]
    code = _CODE.take(text[begin])
    value, sound = _numbers(array, begin + (_ROOM + 1), end + _ROOM)
    sound &= code < kinds
    if not sound.all():
        good[line[~sound]] = False
        code[~sound] = 0
    words = np.full((kinds, count), np.nan)
    words.reshape(-1)[code * np.intp(count) + line] = value
    # Where a letter stands twice there are fewer words than stretches.
    given = np.bincount(line, minlength=count)
    good &= (given > 0) & (np.isfinite(words).sum(0, dtype=np.int8) == given)
    return good, words


def _uncomment(
    signs: Ints, begin: Ints, end: Ints, last: Ints, line: Ints, read: Mask, own: Mask
) -> Ints:
    """Take the comments out of what is looked at, `own`; the ends of stretches without them."""
    at = np.searchsorted(end, signs)
    opens = read[line[at]] & (np.diff(line[at], prepend=-1) != 0)
    if not opens.any():
        return end
    at, signs = at[opens], signs[opens]
    end = end.copy()
    inside = signs > begin[at]
    end[at[inside]] = signs[inside]
    changes = np.bincount(at + inside, minlength=len(end) + 1)
    changes -= np.bincount(last[line[at]] + 1, minlength=len(end) + 1)
    own &= np.cumsum(changes[:-1]) == 0
    return end


def _trim(begin: Ints, end: Ints, mark: NDArray[np.uint8], own: Mask) -> None:
    """Take blanks at the ends of lines out of what is looked at."""
    empty = np.flatnonzero(own & (begin == end))
    if not len(empty):
        return
    ends = mark[empty] == 10
    for _ in range(3):
        own[empty[ends | ~own[(empty + 1) % len(own)]]] = False


def _numbers(array: NDArray[np.uint8], at: Ints, end: Ints) -> tuple[Floats, Mask]:
    """The numbers between these places, and which are numbers; exactly as `float` reads them."""
    negative = array[at] == ord("-")
    size = np.minimum(end - at, 100).astype(np.int8) - negative.view(np.int8)
    sound = (size > 0) & (size <= _LONGEST + 1)
    whole, places, points = _whole(array, end, np.minimum(size, 8), sound)
    long = np.flatnonzero(sound & (size > 8))
    if len(long):
        fine = np.ones(len(long), bool)
        high, more, point = _whole(array, end[long] - 8, size[long] - 8, fine)
        whole[long] += high * _TENS[points[long]]
        places[long] += more + 8 * point
        points[long] += point
        sound[long] &= fine
    sound &= (points <= 1) & (size > points) & (size - points <= _LONGEST)
    value = whole.astype(float)
    value /= _POWERS.take(places)
    minus = np.flatnonzero(negative)
    value[minus] = -value[minus]
    return value, sound


def _whole(
    array: NDArray[np.uint8], end: Ints, size: NDArray[np.int8], sound: Mask
) -> tuple[NDArray[np.uint64], Ints, NDArray[np.int8]]:
    """The digits of texts of 1 to 8 bytes as whole numbers: all at once in 64 bits each.

    Also how many of them stand behind a point, and how many points there are, 0 or 1. What is no
    digit makes a text unsound.
    """
    eights = np.ndarray((len(array) - 7,), "<u8", array, strides=(1,))
    # Digits become 0 to 9; the first is the lowest byte, before it stand zeros.
    before = ((8 - np.clip(size, 1, 8)) << 3).astype(np.uint64)
    digits = ((eights[end - 8] ^ _ALL * 0x30) >> before) << before
    # The highest bit of the first byte that is a point; then what is before it moves up by one.
    found = digits ^ _ALL * (0x30 ^ ord("."))
    found = (found - _ALL) & ~found & (_ALL << 7)
    found &= -found
    point = found != 0
    lower = (found >> 7) - 1
    digits = ((digits & lower) << (point.astype(np.uint64) << 3)) | (digits & -(found << 1))
    places = ((found >> 7) * 0x0706050403020100) >> 56
    sound &= ((digits + _ALL * 0x76) | digits) & (_ALL << 7) == 0
    # Pairs of digits, then of pairs, then of fours.
    digits = (digits * (1 + (10 << 8))) >> 8 & 0x00FF00FF00FF00FF
    digits = (digits * (1 + (100 << 16))) >> 16 & 0x0000FFFF0000FFFF
    digits = (digits * (1 + (10000 << 32))) >> 32
    return digits, places.view(np.intp), point.view(np.int8)
