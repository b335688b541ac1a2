"""Each line once and in order, or a stop that says where: under faults of every kind covered."""

import random
from collections import Counter

import pytest
from streams import program, send

from fdjax.machine import virtual

LINES = 2000
ACCIDENTS = ("stall", "reset", "unplug")


def faulty(folder, machine, seed):
    """One run with up to 5 % faulty exchanges, and perhaps an accident."""
    chance = random.Random(seed)
    rate = chance.uniform(0, 0.05)
    accident = (chance.randrange(5, LINES), chance.choice(ACCIDENTS)) if seed % 3 == 0 else None
    told = seed % 2 == 0  # of a grbl: half of them do not tell their buffer
    port = {"faults": virtual.faults(machine, rate, seed, buffer_report=told), "accident": accident}
    options = {}
    if machine == "marlin":
        options = {name: chance.random() < 0.5 for name in ("advanced", "keepalive", "wait")}
        options["bare_resend"] = chance.random() < 0.3
        port["returns"] = chance.random() < 0.5
    if machine == "grbl":
        options["buffer_report"] = told
    pace = chance.choice([0.0, 0.01])
    job = program(folder, machine, LINES, seed)
    return send(job, machine, port=port, pace=pace, **options), accident


def count(folder, machine, seeds):
    verdicts, faults, wrong = Counter(), Counter(), []
    for seed in seeds:
        run, accident = faulty(folder, machine, seed)
        verdict = run.verdict()
        if verdict not in ("whole", "stopped"):
            wrong.append((seed, verdict, str(run.error)))
            print(machine, wrong[-1], flush=True)
        verdicts[verdict + (" after an accident" if verdict == "stopped" and accident else "")] += 1
        faults.update(run.port.faults.counts if run.port.faults else {})
    print(f"\n{machine}: {dict(verdicts)}; {sum(faults.values())} faults: {dict(faults)}")
    assert wrong == []
    return verdicts


@pytest.mark.parametrize("machine", virtual.MACHINES)
def test_a_few_runs_under_faults(tmp_path, machine):
    verdicts = count(tmp_path, machine, range(1000, 1006))
    assert verdicts["whole"] >= 3


@pytest.mark.slow
@pytest.mark.parametrize("machine", virtual.MACHINES)
def test_a_thousand_runs_under_faults(tmp_path, machine):
    verdicts = count(tmp_path, machine, range(1000))
    # Faults of the kinds covered are got over, all but a few; accidents may end a print.
    assert verdicts["stopped"] <= 50


@pytest.mark.parametrize("seed", range(4))
def test_a_reset_at_the_end_of_a_job_is_found_out(tmp_path, seed):
    """Though what is left of it homes the machine, and needs no homing itself."""
    job = program(tmp_path, "fdm1650", 100, seed)
    frames = len(list(job.commands()))
    for back in range(1, 12, 2):
        faults = virtual.faults("fdm1650", 0.02 * (seed % 2), seed)
        run = send(job, "fdm1650", port={"faults": faults, "accident": (frames - back, "reset")})
        assert run.verdict() == "stopped"


@pytest.mark.parametrize("machine", virtual.MACHINES)
def test_without_faults_the_machine_runs_the_file(tmp_path, machine):
    run = send(program(tmp_path, machine, LINES), machine)
    assert run.error is None
    assert run.verdict() == "whole"
    assert run.stream.protocol.proven_line == max(c.line for c in run.stream.program.commands())


def test_the_verdict_can_fail(tmp_path):
    run = send(program(tmp_path, "marlin", 100), "marlin")
    run.machine.executed.insert(50, run.machine.executed[49])
    assert run.verdict() == "not the file"
