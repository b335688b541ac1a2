"""The text of G-code: a line without comment and frame, its command, and the command's words."""

import math
import re

from fdjax.errors import InputError

_NUMBER = r"(-?[0-9]*\.?[0-9]+)"
PLAIN = re.compile(
    rf"(G[01])(?: X{_NUMBER})?(?: Y{_NUMBER})?(?: Z{_NUMBER})?(?: E{_NUMBER})?(?: F{_NUMBER})?\n?"
).fullmatch
"""Command, X, Y, Z, E and F of a motion as nearly all programs write it; None for other lines."""

_COMMENT = re.compile(r"\([^)]*\)|;.*", re.DOTALL)
_FRAME = re.compile(r"^\s*N\d+\s*|\s*\*\s*\d+\s*$", re.IGNORECASE)  # line number, checksum
_COMMAND = re.compile(r"\s*([A-Za-z])\s*(\d+)(\.\d+)?(?![\d._])")
_EXTENDED = re.compile(r"\s*([A-Za-z_]\w*[A-Za-z_]\w*|\$\S+)")
_MODAL = re.compile(r"\s*[XYZEFIJR]\s*[-+.\d]", re.IGNORECASE)
_WORD = re.compile(r'\s*([A-Za-z])\s*([-+]?(?:\d+\.?\d*|\.\d+)|"[^"]*")?')
_TEXT = frozenset(
    f"M{number}"
    for number in (0, 1, 16, 20, 23, 28, 29, 30, 32, 36, 37, 38, 98, 117, 118, 486, 928)
)
"""They end in a text: a message or the name of a file (Marlin 2 `parser.string_arg`; M36 to M38
and M98 are RepRapFirmware's)."""
_SAYS = re.compile(r"\s*(?:N\s*\d+\s*)?(M)\s*(\d+)(?![\d.])", re.IGNORECASE)


class NoCommand(InputError):
    """A line that is none in any firmware's language."""


class Refused(InputError):
    """A line that the firmware understands, and does not run."""


def code_of(line: str) -> str:
    """A line of a file without comments and frame; empty where nothing is left.

    A message keeps its parentheses, which are no comment to Marlin (PAREN_COMMENTS is off unless
    asked for).

    >>> code_of("N7 G1 X10 (to the left) Y2*33 ; and on")
    'G1 X10  Y2'
    """
    if "(" in line:
        says = _SAYS.match(line)
        if says is None or f"M{int(says[2])}" not in _TEXT:
            line = _COMMENT.sub("", line)
    if ";" in line:
        line = line.partition(";")[0]
    if "*" in line or line[:1] in "Nn \t":
        line = _FRAME.sub("", line)
    return line.strip()


def command_of(code: str) -> tuple[str, int]:
    """The command's name, and where its words begin; `("", 0)` for words that go on with the last.

    A command of Klipper's kind (`SET_FAN SPEED=1`) or of grbl's (`$H`), or one that ends in a text,
    has its words behind the end. Raises `NoCommand` for what is none.

    >>> command_of("g01 X10"), command_of("M117 T1 to go"), command_of("X10")
    (('G1', 3), ('M117', 13), ('', 0))
    """
    if _MODAL.match(code):
        return "", 0
    match = _COMMAND.match(code)
    if match is None:
        extended = _EXTENDED.match(code)
        if extended is None:
            raise NoCommand(f"{code.strip()[:30]!r} is no command")
        return extended[1].upper(), len(code)
    name = f"{match[1].upper()}{int(match[2])}{match[3] or ''}"
    return name, len(code) if name in _TEXT else match.end()


def end_of_name(code: str) -> int:
    """Where the name of a command ends, whatever follows.

    >>> end_of_name("M117 T1"), end_of_name("SET_PIN PIN=a")
    (4, 7)
    """
    match = _COMMAND.match(code) or _EXTENDED.match(code)
    return match.end() if match else 0


def words_of(code: str, at: int = 0, *, bare: bool = True) -> dict[str, float]:
    """The words of a command, behind its name: letters and numbers.

    A letter alone or with a quoted text counts as 0, where that may be (`bare`). Raises
    `InputError` for what is no word, where a letter stands twice, and for a number with an
    exponent: Marlin reads `E6.65e-01` as 6.65 (`GCodeParser::value_float` stops at the e), Klipper
    as -1 (its words end at letters).

    >>> words_of("G1 X10 F1200", 2)
    {'X': 10.0, 'F': 1200.0}
    """
    words: dict[str, float] = {}
    end = len(code.rstrip())
    last = None
    while at < end:
        word = _WORD.match(code, at)
        if word is None or not (bare or (word[2] and word[2][0] != '"')):
            raise InputError(f"{code[at : at + 20].strip()!r} is no letter with a number")
        key, value = word[1].upper(), word[2] or "0"
        if last is not None and _is_exponent(last, word, "E" in words):
            number = f"{last[0].strip()}{word[0]}"
            raise InputError(f"{number!r} has an exponent, which firmware reads otherwise")
        if key in words and key not in "GM":
            raise InputError(f"{key} stands twice in {code.strip()[:40]!r}")
        words[key] = 0.0 if value[0] == '"' else float(value)
        if math.isinf(words[key]):
            raise InputError(f"{key} is too large in {code.strip()[:40]!r}")
        at = word.end()
        last = word
    return words


def _is_exponent(before: re.Match[str], word: re.Match[str], again: bool) -> bool:
    """Whether a word is the exponent of the number before it, `again` if there was an E already.

    In `G1 X1E-5`, written without blanks, it is none.
    """
    joined = word.start(1) == before.end() and before[2]
    return bool(joined and word[1] in "eE" and (again or (word[1] == "e" and before[1].isupper())))


def parse(code: str) -> tuple[str, dict[str, float]]:
    """The command and its words, as `command_of` and `words_of` have them.

    >>> parse("G1 X10 F1200")
    ('G1', {'X': 10.0, 'F': 1200.0})
    """
    name, at = command_of(code)
    return name, words_of(code, at)
