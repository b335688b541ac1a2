"""Settings that hold until they are given again: kept as they were said, to be said again."""

import re
from collections.abc import Mapping

from fdjax.gcode.firmware import Kept

Settings = dict[tuple[str, str, float], dict[str, str]]
"""Words of each setting by its command, whose it is, and the mm of a unit when it was said; the
one that was said last stands last."""

_WORD = re.compile(r'([A-Za-z])\s*("[^"]*"|[-+.\d:]*)')
_PARAMETER = re.compile(r'(\w+)\s*=\s*("[^"]*"|\S+)')


def said(code: str, at: int) -> dict[str, str]:
    """Words of a command as text, or Klipper's parameters where it has them.

    >>> said("M572 D0:1 S.05", 4), said("SET_PIN PIN=led VALUE=0.5", 7)
    ({'D': '0:1', 'S': '.05'}, {'PIN': 'led', 'VALUE': '0.5'})
    """
    found = _PARAMETER.findall(code, at) or _WORD.findall(code, at)
    return {name.upper(): text for name, text in found}


def state_name(code: str, at: int) -> str:
    """The name under which a command saves the state, or brings it back.

    >>> state_name("RESTORE_GCODE_STATE NAME=a MOVE=1", 19), state_name("G60", 3)
    ('a', '0')
    """
    words = said(code, at)
    return words.get("NAME", "default") if "_" in code[:at] else words.get("S", "0")


def keep(
    settings: Settings, name: str, kept: Kept, words: Mapping[str, str], *, scale: float, tool: int
) -> None:
    """Note a setting; `tool` is in use, `scale` mm of a unit."""
    whose = {letter: words[letter] for letter in kept.by if letter in words}
    if kept.of_tool and kept.of_tool not in whose:
        whose[kept.of_tool] = str(tool)
    forget(settings, kept.ends)
    key = (name, _text(name, whose)[len(name) + 1 :], scale)
    before = settings.pop(key, {})  # said last, it stands last
    dropped = "".join(kept.over.get(word, "") for word in words)
    merged = {word: text for word, text in before.items() if word not in dropped}
    merged |= {word: text for word, text in words.items() if word not in (*whose, *kept.once)}
    if merged or kept.bare:
        settings[key] = merged


def forget(settings: Settings, names: tuple[str, ...]) -> None:
    """Settings of these commands are out of force."""
    for key in [key for key in settings if key[0] in names]:
        del settings[key]


def lines(settings: Settings, *, tools: int) -> list[str]:
    """Commands that bring all of them into force again, in mm before and after them.

    A machine of one tool is not told which.
    """
    found = []
    for (name, whose, scale), words in settings.items():
        whose = "" if tools == 1 and whose == "T0" else whose
        line = _text(f"{name} {whose}".strip(), words)
        found += [line] if scale == 1 else ["G20", line, "G21"]
    return found


def _text(name: str, words: Mapping[str, str]) -> str:
    extended = not name[1:2].isdigit()
    return " ".join([name, *(f"{w}={t}" if extended else f"{w}{t}" for w, t in words.items())])
