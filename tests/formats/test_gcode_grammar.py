"""Deposits of a thousand files, by fdjax and by a reader that shares nothing with it."""

import math
import random

import numpy as np
import pytest
from gcode_grammar import deposit, program

from fdjax.formats import gcode, gcode_scan, gcode_track
from fdjax.gcode.firmware import firmware_of
from fdjax.gcode.state import GcodeState
from fdjax.gcode.words import code_of, parse, words_of

AREA = math.pi / 4 * 1.75**2


@pytest.mark.parametrize("firmware", ["marlin", "klipper", "rrf"])
def test_a_third_of_a_thousand_files(firmware, monkeypatch):
    for seed in range(334):
        # Every second file is read line by line, the others in bulk.
        monkeypatch.setattr(gcode_track, "_FEW", 10**9 if seed % 2 else 0)
        text = program(seed, firmware)
        expected = deposit(text, firmware, AREA)
        if expected:
            build = gcode.read(text, filament=1.75, firmware=firmware, layer_height=0.2)
            assert build.volume == pytest.approx(expected, rel=1e-6), seed


def test_bulk_is_what_the_interpreter_does_line_by_line(monkeypatch):
    for seed in range(100):
        text = program(seed, "marlin").encode()
        tracks, states = [], []
        for few in (0, 10**9):
            monkeypatch.setattr(gcode_track, "_FEW", few)
            states.append(GcodeState(firmware_of("marlin")))
            tracks.append(
                gcode_track.track(
                    text,
                    states[-1],
                    comment=lambda *_: None,
                    thing=lambda *_: None,
                    keeps_short=lambda: False,
                )
            )
        for name in gcode_track.COLUMNS:
            one, other = (getattr(track, name) for track in tracks)
            assert np.array_equal(one, other), (seed, name)
        assert states[0] == states[1], seed


def test_what_is_read_at_once_is_what_the_interpreter_reads():
    chance = random.Random(11)
    lines = []
    for _ in range(40_000):
        words = [chance.choice(["G0", "G1", "G1", "G92", "G10"])]
        for letter in chance.sample("XYZEF", chance.randint(0, 5)):
            size = 10 ** chance.randint(0, 9)
            number = f"{chance.uniform(-size, size):.{chance.choice([0, 1, 3, 5, 8, 13])}f}"
            words.append(letter + number.replace("0.", ".", chance.randint(0, 1)))
        line = " ".join(words) + chance.choice(["", "", " ", "  ", " ; X1", ";F", ".", "\t"])
        if chance.random() < 0.2:
            at = chance.randrange(len(line))
            line = line[:at] + chance.choice("GXE09.-+ ;\t(e*/:\x01") + line[at + 1 :]
        lines.append(line)
    numbers = 0
    for block in gcode_scan.blocks("\n".join(lines).encode()):
        for index in np.flatnonzero(block.plain | block.resets).tolist():
            name, words = parse(code_of(block.text(index)))
            assert name == ("G92" if block.resets[index] else block.text(index)[:2])
            told = zip("XYZEF", block.words[:, index].tolist(), strict=True)
            assert {letter: value for letter, value in told if value == value} == words
            numbers += len(words)
    assert numbers > 10_000


def test_a_file_longer_than_a_block_is_cut_between_lines(monkeypatch):
    text = "".join(program(seed, "marlin") for seed in range(20)).encode()
    whole = list(gcode_scan.blocks(text))
    monkeypatch.setattr(gcode_scan, "_BLOCK", 100)
    pieces = list(gcode_scan.blocks(text))
    assert len(pieces) > 100 > len(whole)
    assert b"".join(block.data for block in pieces) == text
    lines = [block.text(k) for block in pieces for k in range(len(block.start))]
    assert lines == text.decode().splitlines()
    assert pieces[-1].first + len(pieces[-1].start) == len(lines) + 1


@pytest.mark.parametrize(
    ("line", "plain"),
    [
        ("G1 X10 Y-.5 Z0.2 E1.25 F1200", True),
        ("G0 F600 Y3 X1 ; there", True),
        ("G1 E-0.00001", True),
        ("G1 X10. Y-12345678.1234567", True),
        ("G1 X123456789012345 Y0.00000000000001", True),
        ("G1 X1 ;Y2 ; Z", True),
        ("G1 X1;Y2", True),
        ("G1 X1   ", True),
        ("G1 X1234567890123456", False),
        ("G1 X1\x01Y2", False),
        ("G1 X1.-", False),
        ("G1 X-", False),
        ("G1 X/1", False),
        ("G1 X1:", False),
        ("G1 X.5\r", False),
        ("G1 X1  Y2", False),
        ("G1 X1Y2", False),
        ("G1 X1 X2", False),
        ("G1 X1.2.3", False),
        ("G1 X1-2", False),
        ("G1 X", False),
        ("G1 X. Y1", False),
        ("G1 X1 E6.65e-01", False),
        ("G1 X1 A2", False),
        ("G1 X+1", False),
        ("G1 X1 (aside)", False),
        ("G1 X0.12345678901234567", False),
        ("G10 X1", False),
        ("G1", False),
        (" G1 X1", False),
        ("N1 G1 X1*3", False),
    ],
)
def test_plain_lines_are_those_that_nothing_can_be_wrong_with(line, plain):
    [block] = gcode_scan.blocks(line.encode())
    assert block.plain.tolist() == [plain]
    assert block.others.tolist() == [not plain]
    if plain:
        told = {name: v for name, v in zip("XYZEF", block.words[:, 0], strict=True) if v == v}
        assert told == words_of(code_of(line), 2)
