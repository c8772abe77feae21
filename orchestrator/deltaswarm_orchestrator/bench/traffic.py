"""Record the traffic of a run, sample by sample, for the own-traffic floor to replay."""

from deltaswarm_orchestrator.bench.own_traffic import Answer, SentSample, StepTraffic, Traffic
from deltaswarm_orchestrator.run.in_process import InProcess
from deltaswarm_scenario.scenario import Scenario
from deltaswarm_wire.keys import ACT, RADIO, REPORT
from deltaswarm_wire.messages import encode_frame
from deltaswarm_wire.operator_messages import Clock, encode_clock, encode_forwarded


def answer(report_bytes: bytes | None, radio: bytes | None, act_bytes: bytes) -> Answer:
    """Return an agent's samples in a step: its report, then its act, attached to its radio frame if it sends one."""
    act = SentSample(ACT, len(act_bytes)) if radio is None else SentSample(RADIO, len(radio), len(act_bytes))
    return (act,) if report_bytes is None else (SentSample(REPORT, len(report_bytes)), act)


def traffic_of(scenario: Scenario) -> Traffic:
    """Return a run's traffic; the run is done in this process."""
    swarm, count = InProcess(scenario), scenario.run.steps
    answers: list[list[Answer]] = [[] for _ in swarm.agents]
    steps = []
    for step in range(count):
        clock = Clock(step, swarm.step(step, step == count - 1).time_s, step == count - 1)
        swarm.close_step(clock)
        given = [answer(out.report_bytes, out.radio, out.act_bytes) for _, _, out in swarm.exchanged]
        for (agent, _, _), samples in zip(swarm.exchanged, given, strict=True):
            answers[agent].append(samples)
        steps.append(
            StepTraffic(
                tuple((agent, len(encode_frame(frame))) for agent, frame, _ in swarm.exchanged),
                sum(map(len, given)),
                tuple(len(encode_forwarded(forwarded)) for forwarded in swarm.world.forwarded),
                len(encode_clock(clock)),
            )
        )
    return Traffic(len(swarm.agents), steps, answers)
