"""A run's own traffic: recorded in one process, and replayed over Zenoh by processes that compute nothing."""

import pytest

from deltaswarm_orchestrator.bench.own_traffic import SentSample, StepTraffic, Traffic, own_traffic_steps_per_s
from deltaswarm_orchestrator.bench.speed import answer, bench_scenario, traffic_of
from deltaswarm_orchestrator.run.in_process import run_in_process
from deltaswarm_wire.keys import ACT, RADIO, REPORT


def test_an_act_travels_with_the_radio_frame_if_there_is_one() -> None:
    """The report comes first, the act closes the step."""
    assert answer(None, None, b"act") == (SentSample(ACT, 3),)
    assert answer(None, b"frame", b"act") == (SentSample(RADIO, 5, 3),)
    assert answer(b"report", b"frame", b"act") == (SentSample(REPORT, 6), SentSample(RADIO, 5, 3))


def test_the_traffic_is_that_of_the_run() -> None:
    """Samples, bytes, frames of asked agents, and reports, as the run's own records count them."""
    scenario = bench_scenario(8, 60)
    traffic, records = traffic_of(scenario), run_in_process(scenario).step_records
    assert [len(step.frames) for step in traffic.steps] == [record.agents_asked for record in records]
    assert [len(step.reports) for step in traffic.steps] == [record.reports_arrived for record in records]
    sent = [sample for answers in traffic.answers for samples in answers for sample in samples]
    assert sum(step.answers for step in traffic.steps) == len(sent)
    radio_bytes = sum(sample.payload_bytes for sample in sent if sample.leaf == RADIO)
    assert radio_bytes == sum(record.bytes_sent for record in records) > 0
    for agent, answers in enumerate(traffic.answers):
        assert len(answers) == sum(agent == asked for step in traffic.steps for asked, _ in step.frames)


@pytest.mark.processes
def test_a_replay_exchanges_all_samples_and_ends() -> None:
    """Every kind of sample, a step without any, and an agent that is not asked in each step."""
    first = (SentSample(REPORT, 90), SentSample(RADIO, 300, 40))
    second = (SentSample(ACT, 40),)
    steps = [
        StepTraffic(((0, 200), (1, 30_000)), 3, (100,), 20),
        StepTraffic((), 0, (), 20),
        StepTraffic(((1, 150),), 1, (), 20),
    ]
    assert own_traffic_steps_per_s(Traffic(2, steps, [[first], [second, second]])) > 0
