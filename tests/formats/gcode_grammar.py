"""Valid G-code by a grammar, and a reader of it that shares nothing with fdjax's."""

import math
import random
import re


def program(seed: int, firmware: str) -> str:
    """A file of flat layers that this firmware takes."""
    chance = random.Random(seed)

    def number(low: float, high: float) -> str:
        return f"{chance.uniform(low, high):.{chance.choice([0, 1, 3, 5])}f}"

    lines = ["G21", "G90", chance.choice(["M82", "M83"]), "G92 E0", "G0 X50 Y50 F6000"]
    relative, absolute, e, z = lines[2] == "M83", True, 0.0, 0.0
    for _ in range(chance.randint(1, 4)):
        z = round(z + 0.2, 3)
        lines += ["G90"] * (not absolute) + [f"G1 Z{z:g} F600"]
        if not absolute:
            absolute = True
            relative = False if firmware == "marlin" else relative
        lines.append("M83" if relative else "M82")
        lines += [f"G1 X{number(40, 60)} Y{number(40, 60)}"]
        for _ in range(chance.randint(1, 60)):
            kind = chance.random()
            in_mode = relative or (not absolute and firmware in ("marlin", "klipper"))
            low, high = (40, 60) if absolute else (-5, 5)
            words = [f"X{number(low, high)}", f"Y{number(low, high)}"]
            chance.shuffle(words)
            words = words[: chance.choice([1, 2, 2, 2])]
            if kind < 0.55:
                step = float(number(0.01, 2))
                e = round(e + step, 5)
                words.append(f"E{step:g}" if in_mode else f"E{e:.5f}")
                if chance.random() < 0.1 and firmware != "klipper":
                    words.append("F" + str(chance.randint(600, 9000)))
                line = " ".join([chance.choice(["G1", "G1", "G01", "g1"]), *words])
                lines.append(line + chance.choice(["", "", "", " ; " + "on we go", "  "]))
            elif kind < 0.7:
                lines.append(f"G0 {' '.join(words)} F7200")
            elif kind < 0.78 and absolute:
                back = chance.choice([0.8, 2])
                lines.append(f"G1 E{-back if in_mode else round(e - back, 5):g} F2400")
                lines.append(f"G0 X{number(40, 60)} Y{number(40, 60)}")
                lines.append(f"G1 E{back if in_mode else e:.5f} F2400")
            elif kind < 0.83:
                lines.append(f"G92 E{0 if chance.random() < 0.7 else 3}")
                e = float(lines[-1][5:])
            elif kind < 0.87:
                relative = not relative
                lines.append("M83" if relative else "M82")
                lines.append("G92 E0")
                e = 0.0
            elif kind < 0.9:
                absolute = not absolute
                lines.append("G90" if absolute else "G91")
                if firmware == "marlin":
                    relative = not absolute
                lines.append("G92 E0")
                e = 0.0
            elif kind < 0.93:
                lines.append(f"M221 S{chance.choice([50, 95, 110])}")
            else:
                lines.append(chance.choice(["M106 S255", "M204 P800", "M73 P4 R5", "", "; aside"]))
    return "\n".join(lines) + "\n"


def deposit(text: str, firmware: str, area: float) -> float:
    """Volume along moves in X and Y, mm^3; what was pulled back comes first."""
    x = y = z = e = owed = total = 0.0
    absolute, by_word, flow = True, False, 1.0
    by_last = False
    for line in text.splitlines():
        words = line.split(";")[0].upper().split()
        if not words:
            continue
        given = {word[0]: float(word[1:]) for word in words[1:]}
        name = re.sub(r"^G0(\d)", r"G\1", words[0])
        if name in ("G90", "G91"):
            absolute, by_last = name == "G90", name == "G91"
        elif name in ("M82", "M83"):
            by_word = by_last = name == "M83"
        elif name == "M221":
            flow = given["S"] / 100
        elif name == "G92":
            e = given.get("E", e)
        elif name in ("G0", "G1"):
            origin = (0.0, 0.0, 0.0) if absolute else (x, y, z)
            place = [
                given[axis] + at if axis in given else now
                for axis, at, now in zip("XYZ", origin, (x, y, z), strict=True)
            ]
            push = 0.0
            if "E" in given:
                relative = {
                    "marlin": by_last,
                    "klipper": by_word or not absolute,
                    "rrf": by_word,
                }[firmware]
                push = given["E"] if relative else given["E"] - e
                e = e + given["E"] if relative else given["E"]
            push *= flow * area
            paid = min(owed, max(push, 0.0))
            owed += -paid if push > 0 else -push
            if math.dist(place[:2], (x, y)) > 0:
                total += max(push - paid, 0.0)
            x, y, z = place
    return total
